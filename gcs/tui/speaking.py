"""Calls spoken aloud, where the system has a voice: off unless it is asked for, never waited for, never in the way."""

from __future__ import annotations

import contextlib
import queue
import shlex
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence

from gcs.errors import TippathError, UsageError

WITHIN_S = 10.0
"""A call takes a second; a voice that takes longer is ended."""
_POWERSHELL = (
    "Add-Type -AssemblyName System.Speech; "
    "(New-Object System.Speech.Synthesis.SpeechSynthesizer).Speak('{}')"
)  # fmt: skip
VOICES: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("say", ("say", "{}")),
    ("espeak-ng", ("espeak-ng", "{}")),
    ("espeak", ("espeak", "{}")),
    ("spd-say", ("spd-say", "--wait", "{}")),
    ("powershell", ("powershell", "-NoProfile", "-Command", _POWERSHELL)),
)
"""Of macOS, Linux and Windows: the program that is looked for, and how it is called; {} are the words."""


def voice(command: str, which: Callable[[str], str | None] = shutil.which) -> tuple[str, ...]:
    """How words are spoken: by the command given, with {} for the words or the words at its end, or, where it is empty,
    by the first voice of this system. Raises UsageError or TippathError where there is none."""
    if not command:
        for program, words in VOICES:
            if which(program) is not None:
                return words
        names = ", ".join(program for program, _ in VOICES)
        raise TippathError(f"--say: no voice is found on this system ({names}); give one: --say 'COMMAND {{}}'")
    try:
        given = shlex.split(command, posix=sys.platform != "win32")
    except ValueError as error:
        raise UsageError(f"--say {command}: {error}") from error
    if not given or which(given[0]) is None:
        raise UsageError(f"--say {command}: there is no such program")
    return tuple(given) if any("{}" in word for word in given) else (*given, "{}")


class Speaker:
    """Speaks in a thread of its own. What was not spoken yet when something newer came is left out."""

    def __init__(self, words: Sequence[str], run: Callable[..., object] = subprocess.run) -> None:
        self._words = tuple(words)
        self._run = run
        self._next: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._work, name="tippath voice", daemon=True)
        self._thread.start()

    def say(self, text: str) -> None:
        """Speak this; never waits."""
        self._next.put(text)

    def close(self, within_s: float = 1.0) -> None:
        """Speak no more."""
        self._next.put(None)
        self._thread.join(within_s)

    def _work(self) -> None:
        while True:
            text = self._next.get()
            while text is not None:
                try:
                    text = self._next.get_nowait()
                except queue.Empty:
                    break
            if text is None:
                return
            self._speak(text)

    def _speak(self, text: str) -> None:
        command = [word.replace("{}", text) for word in self._words]
        quiet = subprocess.DEVNULL
        with contextlib.suppress(OSError, subprocess.SubprocessError):  # a voice that fails is silent
            self._run(command, stdin=quiet, stdout=quiet, stderr=quiet, timeout=WITHIN_S, check=False)
