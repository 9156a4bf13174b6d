"""What the runs flown so far say of the vehicle, while the card is still being flown: TPP fitted after each run.

The fit is the command's, in a process of its own and of low priority: the recording and the abort key wait for nothing.
Nothing is kept of it; the fit that counts is made after the flight.
"""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gcs.analysis.quantities import amount_in

WITHIN_S = 120.0
"""A fit of a whole card takes seconds."""
WATCHED = ("L_b", "M_a")
"""What ties the rotor to the body in roll and in pitch: the numbers that gains hang on."""


@dataclass(frozen=True, slots=True)
class SoFar:
    """A fit of the runs that were kept."""

    nrmse_percent: Mapping[str, float]
    values: Mapping[str, float]
    """Of WATCHED,"""
    errors: Mapping[str, float]
    """one standard error each."""

    @classmethod
    def of(cls, document: Mapping[str, Any]) -> SoFar:
        """From a `tippath.fit/1` document. Raises KeyError, TypeError and ValueError of another."""
        told = {name: document["parameters"][name] for name in WATCHED}
        return cls(
            {name: float(value) for name, value in document["nrmse_percent"].items()},
            {name: float(one["value"]) for name, one in told.items()},
            {name: float(one["standard_error"]) for name, one in told.items()},
        )

    def words(self, before: SoFar | None) -> str:
        """`so far TPP p 77 q 72 %, L_b 124.3 ± 1.9, M_a 557 ± 8, moved by 0.6 %`."""
        fits = " ".join(f"{name} {value:.0f}" for name, value in self.nrmse_percent.items())
        sizes = ", ".join(f"{name} {amount_in('-', value, self.errors[name])}" for name, value in self.values.items())
        text = f"so far TPP {fits} %, {sizes}"
        if before is None:
            return text
        moved = max(abs(value / before.values[name] - 1) for name, value in self.values.items() if before.values[name])
        return f"{text}, moved by {100 * moved:.1f} %"


Fit = Callable[[Path], SoFar | None]


class FitsSoFar:
    """One fit at a time, of the newest state of a flight; `say` hears what came of it, from a thread of its own."""

    def __init__(self, say: Callable[[str], None], fit: Fit | None = None) -> None:
        self._say = say
        self._command = _Command()
        self._fit = fit or self._command
        self._lock = threading.Lock()
        self._asked: Path | None = None
        self._busy = False
        self._last: SoFar | None = None

    def forget(self) -> None:
        """Another flight begins."""
        with self._lock:
            self._asked = self._last = None
        self._say("")

    def after(self, flight: Path) -> None:
        """A run was kept: fit again, once the fit under way is over. Never waits."""
        with self._lock:
            self._asked = flight
            if self._busy:
                return
            self._busy = True
        threading.Thread(target=self._work, name="tippath so far", daemon=True).start()

    def close(self) -> None:
        """End the process, where one runs."""
        with self._lock:
            self._asked = None
        self._command.end()

    def _work(self) -> None:
        while True:
            with self._lock:
                flight, self._asked = self._asked, None
                if flight is None:
                    self._busy = False
                    return
            found = self._fit(flight)
            with self._lock:
                before, self._last = self._last, found or self._last
            if found is not None:
                self._say(found.words(before))


class _Command:
    """`tippath fit FLIGHT --model tpp`, as a process."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None

    def __call__(self, flight: Path) -> SoFar | None:
        """None where these runs do not make a fit yet."""
        command = [sys.executable, "-m", "gcs.cli", "fit", str(flight), "--model", "tpp", "--json"]
        try:
            with subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
            ) as process:
                self._process = process
                _come_last(process)
                written, _ = process.communicate(timeout=WITHIN_S)
            return SoFar.of(json.loads(written)) if process.returncode == 0 else None
        except subprocess.TimeoutExpired:
            self.end()
            return None
        except (OSError, KeyError, TypeError, ValueError):  # it is a comfort, and never in the way of the flight
            return None
        finally:
            self._process = None

    def end(self) -> None:
        """Kill it."""
        process = self._process
        if process is not None:
            with contextlib.suppress(OSError):
                process.kill()


def _come_last(process: subprocess.Popen[bytes]) -> None:
    """The recording comes first."""
    if sys.platform != "win32":
        with contextlib.suppress(OSError):  # it may be over already
            os.setpriority(os.PRIO_PROCESS, process.pid, 10)
