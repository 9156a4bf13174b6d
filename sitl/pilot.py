"""The pilot of the simulated vehicle: lines on standard input, one reply each.

On purpose out of a ground station's reach: over MAVLink nobody arms, takes off or throws the pilot's switch.
"""

from __future__ import annotations

import os
import queue
import threading
from collections.abc import Callable

from sitl.autopilot.modes import Mode, Reason
from sitl.autopilot.vehicle import Vehicle

_HELP = (
    "takeoff | land | lqr on|off | switch low|middle|high | mode "
    + "|".join(mode.name.lower() for mode in Mode)
    + " | reboot | quit"
)


def obey(vehicle: Vehicle, line: str) -> str:
    """Do what the line says and reply with `ok`, or with `refused: ` and the reason. `quit` is the caller's."""
    match line.lower().split():
        case ["takeoff"]:
            refusal = vehicle.take_off()
        case ["land"]:
            refusal = vehicle.land()
        case ["lqr", ("on" | "off") as position]:
            refusal = vehicle.select_lqr(position == "on")
        case ["switch", ("low" | "middle" | "high") as position]:
            vehicle.switch = position
            refusal = None if vehicle.gain_switch else "no script holds gains behind a switch"
        case ["reboot"]:
            refusal = vehicle.reboot()
        case ["mode", name] if name.upper() in Mode.__members__:
            before = len(vehicle.texts)
            accepted = vehicle.set_mode(Mode[name.upper()], Reason.PILOT)
            said = [text for _, text in list(vehicle.texts)[before:]]
            refusal = None if accepted else "; ".join(said) or "not possible now"
        case _:
            refusal = f"unknown line; there are: {_HELP}"
    return "ok" if refusal is None else f"refused: {refusal}"


class PilotLines:
    """Lines from a file descriptor, without ever making the vehicle wait."""

    def __init__(self, descriptor: int, on_end: Callable[[], None] | None = None) -> None:
        self._lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._descriptor = descriptor
        self._on_end = on_end
        # A daemon with os.read: the interpreter can end while it waits, and no lock of sys.stdin is held.
        threading.Thread(target=self._listen, name="pilot", daemon=True).start()

    def take(self) -> list[str]:
        """The lines that came since the last time."""
        lines = []
        while not self._lines.empty():
            lines.append(self._lines.get())
        return lines

    def _listen(self) -> None:
        rest = b""
        while True:
            try:
                data = os.read(self._descriptor, 4096)
            except OSError:
                data = b""
            if not data:
                break
            *lines, rest = (rest + data)[-65536:].split(b"\n")
            for line in lines:
                text = line.decode("utf-8", "replace").strip()
                if text:
                    self._lines.put(text)
        if self._on_end is not None:
            self._on_end()
