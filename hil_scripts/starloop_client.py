"""The earlier name of `starloop.client`, kept for programs that import it: `from starloop.client import Starloop` is the new one."""

from starloop.client import *  # noqa: F403
