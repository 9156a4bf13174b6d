"""The bundled simulated vehicle as a process, and its pilot: what only the person with the transmitter may do.

Nothing here goes over MAVLink: the pilot's lines (`takeoff`, `land`, `lqr on`) are typed into the process, as a pilot
moves switches. A real vehicle has no such process, and the ground station no such words.

The process has a group of its own, so that a Ctrl-C in the terminal reaches us and not the vehicle: it must fly on
until the excitation has been ended. It ends with us in every case: when the context is left, and, should we be killed,
because its standard input closes.
"""

from __future__ import annotations

import contextlib
import json
import os
import queue
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from gcs.errors import TippathError

READY_WITHIN_S = 20.0
"""Starting Python and importing the mathematics takes seconds on a slow machine."""
REPLY_WITHIN_S = 5.0
END_WITHIN_S = 5.0


class PilotError(TippathError):
    """The simulated vehicle did not start, ended, or its pilot could not do as told."""


@dataclass(frozen=True, slots=True)
class Ready:
    """What the vehicle says when it is up."""

    link: str
    """Its own end."""
    ground_link: str
    """What the ground connects to."""
    plant: str
    directory: Path
    """Where it keeps its own logs."""


class SimulatedVehicle:
    """A process that flies. A context manager: leaving it ends the process.

    `listen` is the vehicle's link word; port 0 takes a free one. Raises PilotError where it does not come up.
    """

    def __init__(
        self,
        plant: str,
        directory: Path,
        *,
        listen: str = "udpout:127.0.0.1:0",
        seed: int | None = None,
        on_ground: bool = False,
        loss: float = 0.0,
        more: Sequence[str] = (),
    ) -> None:
        command = [sys.executable, "-m", "sitl", "--until-input-ends"]
        command += ["--plant", plant, "--listen", listen, "-o", str(directory)]
        command += ["--seed", str(seed)] if seed is not None else []
        command += ["--on-ground"] if on_ground else []
        command += ["--loss", str(loss)] if loss else []
        self._errors = directory / "vehicle.err"
        try:
            directory.mkdir(parents=True, exist_ok=True)
            errors = self._errors.open("wb")
        except OSError as error:
            told = f"{directory} cannot be written ({error.strerror or error}); choose another folder with -o DIR"
            raise PilotError(f"the simulated vehicle keeps its logs there, and cannot start: {told}") from error
        with errors:
            self._process = subprocess.Popen(
                [*command, *more],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
                **_own_group(),
            )
        self._lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._reader = threading.Thread(target=self._listen, name="simulated vehicle", daemon=True)
        self._reader.start()
        try:
            self.ready = self._wait_until_ready()
        except BaseException:
            self.close()
            raise

    def _listen(self) -> None:
        assert self._process.stdout is not None
        with contextlib.suppress(OSError, ValueError):
            for raw in self._process.stdout:
                self._lines.put(raw.decode("utf-8", "replace").strip())
        self._lines.put(None)

    def _next_line(self, within_s: float) -> str:
        try:
            line = self._lines.get(timeout=within_s)
        except queue.Empty:
            raise PilotError(f"the simulated vehicle said nothing for {within_s:.0f} s") from None
        if line is None:
            self._lines.put(None)  # so that whoever asks next hears it, too
            raise PilotError(f"the simulated vehicle ended: {self._last_words()}")
        return line

    def _last_words(self) -> str:
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(1.0)
        try:
            said = self._errors.read_text("utf-8", "replace").strip().splitlines()
        except OSError:
            said = []
        return said[-1] if said else f"exit status {self._process.poll()}"

    def _wait_until_ready(self) -> Ready:
        line = self._next_line(READY_WITHIN_S)
        try:
            about = json.loads(line)
            if about["ready"] is not True:
                raise ValueError("not ready")
            return Ready(
                str(about["link"]), str(about["ground_link"]), str(about["plant"]), Path(str(about["directory"]))
            )
        except (ValueError, KeyError, TypeError) as error:
            raise PilotError(f"the simulated vehicle said {line!r} in place of being ready") from error

    @property
    def ground_link(self) -> str:
        """What the ground connects to, for example `udpin:127.0.0.1:14550`."""
        return self.ready.ground_link

    @property
    def directory(self) -> Path:
        """Where the vehicle keeps its own logs."""
        return self.ready.directory

    @property
    def alive(self) -> bool:
        return self._process.poll() is None

    def say(self, line: str) -> str:
        """Give the pilot one line and return his reply. Raises PilotError where he refuses or there is none."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(line.encode() + b"\n")
            self._process.stdin.flush()
        except (OSError, ValueError) as error:
            raise PilotError(f"the simulated vehicle ended: {self._last_words()}") from error
        reply = self._next_line(REPLY_WITHIN_S)
        if reply.startswith("refused"):
            raise PilotError(f"the simulated pilot cannot {line}: {reply.removeprefix('refused').lstrip(': ')}")
        return reply

    def close(self) -> None:
        """End the process: ask, then insist. Twice is no harm."""
        if self._process.stdin is not None and not self._process.stdin.closed:
            with contextlib.suppress(OSError, ValueError):
                self._process.stdin.write(b"quit\n")
                self._process.stdin.flush()
            with contextlib.suppress(OSError):
                self._process.stdin.close()
        for insist in (None, self._process.terminate, self._process.kill):
            if insist is not None:
                insist()
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(END_WITHIN_S)
                break
        self._reader.join(END_WITHIN_S)
        if self._process.stdout is not None:
            self._process.stdout.close()
        with contextlib.suppress(OSError):
            if self._errors.stat().st_size == 0:
                self._errors.unlink()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        interrupted = False
        deadline = time.monotonic() + 4 * END_WITHIN_S
        while True:
            try:
                self.close()
                break
            except KeyboardInterrupt:  # an impatient second Ctrl-C must not leave a vehicle flying
                interrupted = True
                if time.monotonic() > deadline:
                    raise
        if interrupted and error is None:
            raise KeyboardInterrupt


def _own_group() -> dict[str, Any]:
    if os.name == "nt":
        return {"creationflags": 0x00000200}  # CREATE_NEW_PROCESS_GROUP
    return {"start_new_session": True}
