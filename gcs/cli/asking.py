"""A diagnosis under way, on a terminal's standard error: what is asked, the best so far, how long it will take."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from shutil import get_terminal_size
from typing import TextIO

from gcs.analysis.remaining import Remaining
from gcs.analysis.text.progress import asking_words, best_words, first_words, left_words
from gcs.cli.terminal import REDRAW, control
from gcs.logs.words import printable
from sysid.diagnose.progress import Asking, FirstAnswer, Progress, Ranking


class AskingLine:
    """A line on a terminal that is drawn over itself, and the first answer above it; nothing elsewhere."""

    def __init__(self, stream: TextIO | None = None, clock: Callable[[], float] = time.monotonic) -> None:
        self._stream = stream or sys.stderr
        self._clock = clock
        self._ranking = Ranking()
        self._remaining = Remaining()

    def __enter__(self) -> AskingLine:
        return self

    def __call__(self, news: Progress) -> None:
        if not self._stream.isatty():
            return
        self._ranking = self._ranking.after(news)
        if isinstance(news, Asking):
            now_s = self._clock()
            self._remaining = self._remaining.heard(news, now_s)
            left = left_words(self._remaining.left_s(now_s), at_most=self._remaining.at_most)
            parts = (asking_words(news), best_words(self._ranking), left)
            self._draw(f" {printable('   '.join(part for part in parts if part))}")
        elif isinstance(news, FirstAnswer):
            self._draw(f" {printable(first_words(news))}; two together are looked for, Ctrl-C ends that\n")

    def _draw(self, text: str) -> None:
        control(self._stream, REDRAW)
        self._stream.write(text if text.endswith("\n") else text[: get_terminal_size().columns - 1])
        self._stream.flush()

    def __exit__(self, *_: object) -> None:
        if self._stream.isatty():
            control(self._stream, REDRAW)
            self._stream.flush()
