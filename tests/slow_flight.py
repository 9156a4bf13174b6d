"""A vehicle behind a telemetry radio, in fake time: the simulated vehicle, its server, and the commands.

Time goes by only while a command waits. The radio carries `bytes_s` each way, as `tippath sim --bandwidth` does, and
the pilot hears the lines of the simulated vehicle's terminal.
"""

from __future__ import annotations

import functools
import sys
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

import gcs.flight.connection
from gcs.cli import main
from gcs.flight.fetching import fetch as fetching
from gcs.flight.session import Session
from gcs.link.frames import Frame, FrameFinder
from gcs.link.key_file import KeptStamps, read_key
from gcs.link.signing import Signing
from sitl.autopilot.storage import LogStorage
from sitl.autopilot.vehicle import Vehicle, make_vehicle
from sitl.faults.air import Bandwidth, FaultyLink
from sitl.faults.script import arguments, options
from sitl.faults.words import read
from sitl.pilot import obey
from sitl.protocol.links import Address
from sitl.protocol.server import Server
from sitl.protocol.signatures import Signatures

BYTES_S = 5760.0
"""57,600 baud."""
TURN_S = 0.02
TWO_CHIRPS = """
name = "two"
rest_s = 1
[[maneuver]]
kind = "chirp"
axis = "roll"
amplitude = 0.08
duration_s = 6
f_start_hz = 1
noise_fraction = 0
fade_in_s = 1
repeat = 2
"""
"""A card that a flight over a slow radio still ends in a minute."""
RADIO, ANOTHER = ("radio", 1), ("another", 1)
"""Addresses as of datagrams: whole frames."""


def in_one_line(text: str) -> str:
    """What was said, without the line breaks that a terminal's width makes; no traceback is among it."""
    assert "Traceback" not in text
    return " ".join(text.split())


class Wire:
    """Both ends of the radio: the server's link, and the session's transport."""

    def __init__(self, name: str) -> None:
        self.name = self.ground_link = name
        self.known: tuple[Address, ...] = (RADIO,)
        self.others_say: list[bytes] = []
        """What another station sends, over a radio of its own; what it hears is nobody's matter."""
        self._up: list[bytes] = []
        self._down: list[bytes] = []
        self.finder = FrameFinder()
        self.at_ground = self.Ground(self)

    class Ground:
        """The session's."""

        strangers = 0
        newcomer: str | None = None
        receive_buffer: int | None = None
        problem: str | None = None

        def __init__(self, wire: Wire) -> None:
            self.name, self._wire = wire.name, wire

        @property
        def counts(self) -> tuple[int, int]:
            return self._wire.finder.frames, self._wire.finder.bad_bytes

        def receive(self, timeout_s: float) -> list[Frame]:
            down, self._wire._down = self._wire._down, []
            return self._wire.finder.feed(b"".join(down))

        def take_over(self) -> bool:
            return False

        def send(self, data: bytes) -> None:
            self._wire._up.append(data)

        def close(self) -> None:
            """The radio stays on."""

    def receive(self) -> list[tuple[Address, bytes]]:
        up, self._up = self._up, []
        others, self.others_say = self.others_say, []
        return [*((RADIO, data) for data in up), *((ANOTHER, data) for data in others)]

    def gone(self) -> list[Address]:
        return []

    def room(self, address: Address) -> bool:
        return True

    def send(self, address: Address, data: bytes) -> None:
        if address == RADIO:
            self._down.append(data)

    def send_beside(self, address: Address, data: bytes) -> None:
        self.at_ground.strangers += 1

    def close(self) -> None:
        """Nothing to close."""


class SlowFlight:
    """A vehicle, its pilot, and `tippath` at the other end of the radio; a session's pace, too."""

    def __init__(
        self,
        monkeypatch: pytest.MonkeyPatch,
        plant: str,
        like: str | None,
        card: Path,
        *,
        bytes_s: float = BYTES_S,
        on_ground: bool = True,
        settings: dict[str, float] | None = None,
        key: bytes | None = None,
        script: str = "",
        seed: int = 5,
        gain_switch: bool = False,
    ) -> None:
        """With `key` the vehicle obeys only what is signed with it; `script` is a storm as `tippath sim --faults`
        reads it, drawn from the seed."""
        card.mkdir()
        self.vehicle: Vehicle = make_vehicle(
            plant,
            seed,
            directory=card,
            on_ground=on_ground,
            like=like,
            parameters=settings,
            gain_switch=gain_switch,
        )
        self.vehicle.storage = LogStorage(card)
        self.wire = Wire(f"/dev/ttyUSB0,{10 * bytes_s:.0f}")
        storm = read(arguments(options(script), seed), lambda: self.vehicle.systemid.first_s)
        faults = replace(storm, up=(Bandwidth(bytes_s), *storm.up), down=(Bandwidth(bytes_s), *storm.down))
        self.signatures = None if key is None else Signatures(key, self._wall_clock)
        self.air = FaultyLink(self.wire, faults, lambda: self.vehicle.elapsed_s)
        self._server = Server(self.vehicle, self.air, storm.on_board, self.signatures)
        self._steps = round(TURN_S / self.vehicle.dt)
        self._turns: list[Callable[[], None]] = []
        self._beat: Callable[[], None] = lambda: None
        self._next_beat = 0.0
        self.between: Callable[[], None] = lambda: None
        """Called after every turn."""
        time = SimpleNamespace(monotonic=self.now, sleep=self.sleep)
        monkeypatch.setattr(gcs.flight.connection, "time", time)
        monkeypatch.setattr(Session, "open", self._open)
        in_fake_time = functools.partial(fetching.Fetching, clock=self.now, wait=self.sleep)
        monkeypatch.setattr(fetching, "Fetching", in_fake_time)
        monkeypatch.setattr(sys, "stdin", SimpleNamespace(isatty=lambda: True, readline=lambda: "fly\n"))

    def _open(
        self, link: str, *, primary: bool = False, key: Path | None = None, system: int | None = None, dry: bool = False
    ) -> Session:
        signing = None
        if key is not None:
            signing = Signing(read_key(key).secret, KeptStamps(key), wall_clock=self._wall_clock)
        self.wire.finder = FrameFinder(signing)
        session = Session(
            self.wire.at_ground,
            primary=primary,
            signing=signing,
            system=system,
            dry=dry,
            pace=self,
            wall_clock=self._wall_clock,
        )
        session.wait_for_vehicle(5.0)
        return session

    def _wall_clock(self) -> float:
        return 1.7e9 + self.now()

    def now(self) -> float:
        return 1000.0 + self.vehicle.elapsed_s

    def begin(self, turn: Callable[[], None], beat: Callable[[], None]) -> None:
        self._turns, self._beat, self._next_beat = [turn], beat, self.now()

    def end(self) -> None:
        """What was said last still arrives."""
        self._turns, self._beat = [], lambda: None
        self.sleep(0.5)

    def wait(self, event: threading.Event, seconds: float) -> bool:
        end = self.now() + seconds
        while not event.is_set() and self.now() < end:
            self.pass_by()
        return event.is_set()

    def sleep(self, seconds: float) -> None:
        end = self.now() + seconds
        while self.now() < end:
            self.pass_by()

    def pass_by(self) -> None:
        for _ in range(self._steps):
            self.vehicle.step()
        self._server.poll()
        if self.now() >= self._next_beat:
            self._next_beat = self.now() + 1.0
            self._beat()
        for turn in self._turns:
            turn()
        self.between()

    def close(self) -> None:
        self.vehicle.close()

    def pilot(self, line: str) -> None:
        assert obey(self.vehicle, line) == "ok"

    def tippath(self, command: str, *words: str | Path) -> int:
        """The exit status of a command that speaks to the vehicle."""
        return main([command, "--connect", self.wire.name, *map(str, words)])
