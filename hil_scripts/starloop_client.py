"""The name that `starloop.client` had before it was in a package: `from starloop.client import Starloop` is the new one."""

from starloop.client import *  # noqa: F403
