"""One thing at a time: the desk's state, replaced whole under a lock, what is worked on, and calling it off."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from gcs.analysis.remaining import Remaining
from gcs.analysis.text.progress import asking_words, left_words
from gcs.desk.state import Asked, DeskState, Rung
from gcs.errors import TippathError
from sysid.diagnose.progress import Asking, Progress, Ranking
from sysid.errors import SysidError

if TYPE_CHECKING:
    from sysid.fit.result import Fit


class Cancelled(TippathError):
    """The work was called off; nothing was changed."""


class Working:
    """`state` and `cancel` never wait. `on_said` is told every last word; it may not wait."""

    def __init__(self, on_said: Callable[[str], None], clock: Callable[[], float] = time.monotonic) -> None:
        self._on_said = on_said
        self._clock = clock
        self._lock = threading.RLock()
        self._work = threading.Lock()
        self._cancelled = threading.Event()
        self._state = DeskState()
        self._doing = ""
        self._began_s = 0.0
        self._remaining = Remaining()

    def state(self) -> DeskState:
        """This moment."""
        with self._lock:
            if self._state.busy:
                now_s = self._clock()
                left_s = self._remaining.left_s(now_s)
                told = int(now_s - self._began_s), left_words(left_s, at_most=self._remaining.at_most)
                if told != (self._state.busy_s, self._state.left):
                    self._set(busy_s=told[0], left=told[1])
            return self._state

    def cancel(self) -> None:
        """Call off what is being worked on; it ends with `Cancelled` at its next step, and changes nothing."""
        with self._lock:
            if self._state.busy:
                self._cancelled.set()
                self._set(busy=f"calling off: {self._state.busy}", called_off=True)

    def _set(self, **changes: Any) -> None:
        with self._lock:
            self._state = replace(self._state, **changes)
            if changes.get("said"):
                self._on_said(changes["said"])

    def _replace(self, fit: Fit, **changes: Any) -> None:
        """Change the rung of a fit, where it is still on the ladder."""
        with self._lock:
            rungs = self._state.ladder
            self._set(ladder=tuple(replace(one, **changes) if one.fit is fit else one for one in rungs))

    def _say_unless_unkept(self, text: str) -> None:
        with self._lock:
            if not self._state.unkept:
                self._set(said=text)

    def _step(self, what: str, share: float | None = None) -> None:
        """Tell how far the work is; raises Cancelled where it was called off."""
        if self._cancelled.is_set():
            raise Cancelled(f"called off: {self._doing}; nothing was changed")
        self._set(busy=f"{self._doing}: {what}" if what else self._doing, progress=share)

    def _hear(self, news: Progress) -> None:
        """The same of a diagnosis, whose ranking so far is kept when it is called off."""
        with self._lock:
            asked = self._state.asked
            if self._cancelled.is_set():
                kept = "; the ranking so far stays, and is no verdict" if asked is not None and not asked.over else ""
                raise Cancelled(f"called off: {self._doing}{kept or '; nothing was changed'}")
            if isinstance(news, Asking):
                self._remaining = self._remaining.heard(news, self._clock())
                self._set(busy=asking_words(news))
            if asked is not None and not asked.over:
                self._set(asked=replace(asked, ranking=asked.ranking.after(news)))

    @contextlib.contextmanager
    def _ranked(self, rung: Rung) -> Iterator[None]:
        """While a rung is asked its ranking stands beside it; once there is an answer it does not."""
        self._set(asked=Asked(fit=rung.fit, ranking=Ranking()))
        try:
            yield
        except BaseException:
            asked = self._state.asked
            self._set(asked=replace(asked, over=True) if asked is not None and asked.ranking.standings else None)
            raise
        self._set(asked=None)

    @contextlib.contextmanager
    def _working(self, what: str, *, wait: bool = False) -> Iterator[None]:
        """One thing at a time; what the mathematics refuses is told as the data's word."""
        if not self._work.acquire(blocking=wait):
            raise TippathError(f"wait: {self._state.busy or 'something else is being worked on'}")
        try:
            self._doing = what
            with self._lock:
                self._cancelled.clear()
                self._began_s, self._remaining = self._clock(), Remaining()
                self._set(busy=what, progress=None, said="", busy_s=0, left="")
            yield
        except SysidError as error:
            raise TippathError(str(error)) from error
        except Cancelled as end:
            self._set(said=str(end))
            raise
        finally:
            self._set(busy="", called_off=False, progress=None, busy_s=0, left="")
            self._work.release()
