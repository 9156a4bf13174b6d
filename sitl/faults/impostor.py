"""Somebody who gives himself out for the vehicle, towards the ground, or for the ground, towards the vehicle."""

from __future__ import annotations

import random
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.logger import BLOCK_BYTES
from sitl.autopilot.modes import Severity
from sitl.faults.others import Beat, framed, heartbeat_of, start_of_log
from sitl.faults.windows import Once, Window
from sitl.protocol.server import AUTOPILOT, LOGGER, SYSTEM
from sitl.protocol.telemetry import Message

STATION = (254, 190)
"""System and component of the ground that speaks there."""


@dataclass(frozen=True, slots=True)
class Claim:
    """A message, and as whose it is sent."""

    message: Message
    system: int
    component: int
    up: bool
    """To the vehicle."""


def claim(what: str, mode: int, seed: int) -> Claim:
    """What heartbeat=MODE, text=WORDS, block=N, mode=MODE or log stands for; `mode` is that mode's number.

    Raises ValueError for other words.
    """
    name, _, value = what.partition("=")
    match name:
        case "heartbeat":
            return Claim(heartbeat_of(mode, armed=True), SYSTEM, AUTOPILOT, up=False)
        case "text" if 0 < len(value) <= 50 and value.isascii():
            text = mavlink.MAVLink_statustext_message(int(Severity.INFO), value.encode())
            return Claim(text, SYSTEM, AUTOPILOT, up=False)
        case "block" if value.isascii() and value.isdigit() and int(value) < 2**32:
            data = random.Random(f"block {seed}").randbytes(BLOCK_BYTES)
            block = mavlink.MAVLink_remote_log_data_block_message(*STATION, int(value), data)
            return Claim(block, SYSTEM, LOGGER, up=False)
        case "mode":
            order = (mavlink.MAV_CMD_DO_SET_MODE, 0, mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, mode)
            message = mavlink.MAVLink_command_long_message(SYSTEM, AUTOPILOT, *order, 0, 0, 0, 0, 0)
            return Claim(message, *STATION, up=True)
        case "log" if not value:
            return Claim(start_of_log(), *STATION, up=True)
    raise ValueError("heartbeat=MODE, text=WORDS (of 1 to 50 characters), block=N, mode=MODE or log is wanted")


class Impostor:
    """Sends his claim once when the window begins, or `again` and again, once a second in it."""

    def __init__(self, claim: Claim, window: Window, *, again: bool) -> None:
        self._claim = claim
        self._window = window
        self._once = None if again else Once(window)
        self._beat = Beat(1.0, 0.61)
        self._mav = mavlink.MAVLink(None, claim.system, claim.component)

    @property
    def up(self) -> bool:
        return self._claim.up

    def __call__(self, now_s: float) -> list[bytes]:
        if self._once is not None:
            due = self._once.comes(now_s)
        else:
            due = self._beat.due(now_s) and self._window.covers(now_s)
        return [framed(self._mav, self._claim.message)] if due else []
