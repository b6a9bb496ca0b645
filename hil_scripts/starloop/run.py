"""Runs on the virtual clock in this process: the requests of the control socket without a socket."""

from __future__ import annotations

import json
import os
from typing import Any, Dict, Iterator, Mapping, Optional, Union

from . import _native
from .camera import Frame
from .client import Starloop, StarloopError, toml_value

__all__ = ["Run", "StarloopError"]


class Run(Starloop):
    """A run of a bench or scenario; simulated time advances with `step` only.

    It has all requests of `starloop.client.Starloop`: step, inject, attitude, truth, tracker, camera ...

    >>> with Run("benches/closed_loop_small.toml", settings={"timing.duration_s": 2}) as run:
    ...     len(list(run.frames()))
    4
    """

    def __init__(
        self,
        source: Union[str, "os.PathLike[str]"],
        *,
        seed: Optional[int] = None,
        settings: Optional[Mapping[str, Any]] = None,
    ):
        changes = [f"{key}={toml_value(value)}" for key, value in (settings or {}).items()]
        try:
            self._session = _native.Session(os.fspath(source), changes, seed)
        except ValueError as error:
            raise StarloopError(str(error)) from error
        self._is_over = False
        self.exit_status: Optional[int] = None
        self.report: Dict[str, Any] = {}
        """The report of the run, after `finish`."""
        self.hello: Dict[str, Any] = self.request("hello")

    def _ask(self, name: str, begin: str, keys: Dict[str, Any]) -> Dict[str, Any]:
        line = begin + json.dumps({"request": name, **keys}, allow_nan=False)[1:]
        try:
            answer: Dict[str, Any] = json.loads(self._session.ask(line))
        except ValueError as error:
            raise StarloopError(f"{name}: {error}") from error
        return answer

    def newest(self, head: int = 0) -> Optional[Frame]:
        """Returns the newest frame of a head; None before its first."""
        native = self._session.frame(head)
        return None if native is None else Frame(native)

    def frames(self, head: int = 0) -> Iterator[Frame]:
        """Yields the frames of a head, one step each, to the end of the run."""
        shown = -1
        while True:
            finished = self.step(frames=1)["finished"]
            frame = self.newest(head)
            if frame is not None and frame.meta["number"] != shown:
                shown = frame.meta["number"]
                yield frame
            if finished:
                return

    def finish(self) -> Dict[str, Any]:
        """Ends the run and returns its report; `exit_status` is 0, or 4 when an expectation was not met."""
        if not self._is_over:
            text, holds = self._session.finish()
            self._is_over = True
            self.report = json.loads(text)
            self.exit_status = 0 if holds else 4
        return self.report

    def close(self) -> None:
        """Ends the run."""
        self.finish()

    def __enter__(self) -> "Run":
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()
