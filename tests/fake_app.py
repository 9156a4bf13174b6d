"""The app before an engine that shows what it is told to show: moments of a flight, and a fake of everything behind."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import threading
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from fake_desk import DESKS, GAINS, FakeDesk
from textual.pilot import Pilot

from gcs.cards.checklist import answered
from gcs.cards.envelope import Use
from gcs.desk import DeskState, Fitted
from gcs.errors import TippathError
from gcs.flight.live import LiveWindow
from gcs.flight.preflight import Check
from gcs.flight.readiness import Readiness
from gcs.flight.session_notes import SessionNote
from gcs.link.log_answer import LogClient
from gcs.tui.app import TippathApp
from gcs.tui.state import Bank, Mark, Progress, RunView, Stage, State, joined
from gcs.tui.widgets.lines import Lines
from gcs.tui.worker import FlightWorker
from gcs.vehicle.readiness import Item, Standing
from gcs.vehicle.snapshot import Text, VehicleSnapshot

PATIENCE_S = 180.0
"""For what a busy machine shows at last, where a test is not about how long that takes."""

VEHICLE = VehicleSnapshot(
    system=1,
    component=1,
    link_age_s=0.1,
    lost=False,
    mode=0,
    mode_name="Stabilize",
    armed=True,
    heartbeats=3,
    rpm=1648.0,
    battery_v=22.1,
    texts=(Text(1, 0.0, 6, "Frame: HELI"),),
)
RECORDING = replace(VEHICLE, recording=Path("flight-0007/flight.BIN"), blocks_received=900)
RUNS = tuple(
    RunView(number=i, label=f"{axis} {kind} {i % 2 + 1}/2", numbers="0.5-10 Hz  30 s  A 0.10", kind=kind, size="A 0.10")
    for i, (axis, kind) in enumerate(
        itertools.product(("roll", "pitch", "roll", "pitch"), ("chirp", "doublet")), start=1
    )
)
USE = Use(44.0, 24.0, 13.0, 3.0)
LONG = "not ready: in the air: not armed: the pilot arms and takes off, then fly this again; mode: Land; " * 4

IDLE = State(link="udpin:127.0.0.1:14550", plant="hover", vehicle=VEHICLE, stage=Stage.IDLE, card="hover", runs=RUNS)
FLYING = replace(
    IDLE,
    vehicle=replace(RECORDING, mode=25, mode_name="SystemID"),
    stage=Stage.FLYING,
    current=3,
    runs=(
        replace(RUNS[0], mark=Mark.KEEP, why=("coherence 0.5-9.6 Hz", "gaps 0", "44 % of the limits")),
        replace(RUNS[1], mark=Mark.AGAIN, why=("the rates did not answer (they vary by 0.0041 rad/s)",)),
        replace(RUNS[2], mark=Mark.FLYING),
        replace(RUNS[3], mark=Mark.LOCKED, why=("until 3 is clean",)),
        *RUNS[4:],
    ),
    progress=Progress(12.4, 30.0, 4.6, "Table 1"),
    use=USE,
    link_loss="if the link drops: returns home after 5 s",
    rpm_reference=1650.0,
    samples=9120,
    disk_free=41_000_000_000,
    flight=Path("flight-0007"),
    checks=(Check("link", "heard 0.0 s ago"), Check("trim", "delta_x +0.01, delta_y +0.01")),
)
FITTED = replace(
    IDLE,
    flight=Path("flight-0007"),
    desk=DeskState(
        path=Path("flight-0007"),
        fitted=Fitted(
            found=SimpleNamespace(),  # type: ignore[arg-type]
            tables="\n".join(f"row {i:3d} {'x' * 60}" for i in range(60)),
            runs=("flight.BIN#1",),
            validation=(),
            warnings=("look at this " * 12,),
            tpp_path=None,
            cd_path=None,
            commands=("tippath fit " + "flight-0007/flight.BIN#1 " * 8,),
        ),
    ),
)
DESIGNED = replace(
    FITTED,
    vehicle=replace(VEHICLE, armed=False),
    desk=replace(FITTED.desk, designed=replace(GAINS, text="K  1 2 3 4")),
    bank=Bank(0x123456, None, True),
)
MOMENTS = {
    "no vehicle": State(link="udpin:127.0.0.1:14550", card="hover", runs=RUNS, trouble="no vehicle at udpin: " + LONG),
    "idle": IDLE,
    "refused": replace(IDLE, said=LONG),
    "checking": replace(FLYING, stage=Stage.CHECKING, progress=None),
    "ready": replace(FLYING, stage=Stage.READY),
    "flying": FLYING,
    "over the limit": replace(FLYING, use=Use(144.0, None, 99.0)),
    "aborting": replace(FLYING, stage=Stage.ABORTING),
    "held": replace(FLYING, stage=Stage.HELD, said="roll chirp: keep"),
    "closing": replace(FLYING, stage=Stage.CLOSING),
    "lost": replace(FLYING, vehicle=replace(RECORDING, link_age_s=4.2, lost=True)),
    "hardware": replace(FLYING, plant=None, link="/dev/serial/by-id/" + "x" * 70),
    "fitting": replace(IDLE, busy="fitting flight-0007"),
    "fitted": FITTED,
    "designed": DESIGNED,
}
READINESS = Readiness(
    link="/dev/ttyUSB0,57600",
    vehicle="system 1, ArduPilot 4.7.0, helicopter",
    card="hover",
    stream=False,
    items=(
        Item(
            name="LOG_BACKEND_TYPE",
            standing=Standing.MUST,
            value="3",
            words="its log would fill this link [/], and orders wait behind it; log to the card alone",
            wanted=(("LOG_BACKEND_TYPE", 1.0),),
            restart=True,
        ),
        Item(name="state", standing=Standing.MUST, value="5", words="a failsafe is active"),
        *(Item(name=f"thing {n}", standing=Standing.BETTER, value="so", words="could be otherwise") for n in range(6)),
        *(Item(name=f"part {n}", standing=Standing.FINE, value="as it is", words="in order") for n in range(14)),
    ),
)
"""More than a small screen shows, the worst first."""
CHECKED = replace(
    IDLE, plant=None, vehicle=replace(VEHICLE, armed=False, log_client=LogClient.OURS), readiness=READINESS, station=254
)
ANALYSED = {name: joined(replace(IDLE, flight=Path("flight-0007")), desk) for name, desk in DESKS.items()}
"""The moments of the work after the flight."""
NOWHERE = State(link="", card="hover", runs=RUNS)


class FakeWorker:
    """Shows what it is told to show and writes down what is asked of it."""

    def __init__(self, state: State) -> None:
        self.now = state
        self.asked: list[str] = []
        self.notes: list[SessionNote] = []
        self.refusal: str | None = None
        self.called_off = 0
        self.closed = threading.Event()
        self.desk = FakeDesk(self.asked)
        self.desk.now = state.desk
        t = np.arange(10_000) / 500
        quiet = np.zeros(t.size)
        self.samples = LiveWindow(
            t=t,
            p=np.sin(9 * t),
            q=np.cos(5 * t),
            delta_x=0.1 * np.sin(9 * t),
            delta_y=quiet,
            excitation_x=quiet,
            excitation_y=quiet,
        )

    def state(self) -> State:
        self.desk.now = self.now.desk
        return self.now

    def window(self, last_s: float) -> LiveWindow:
        return self.samples

    def ask(self, what: str) -> None:
        self.asked.append(what)
        if self.refusal is not None:
            raise TippathError(self.refusal)

    def ready(self) -> None:
        self.ask("ready")

    def start(self) -> None:
        self.ask("start")

    def choose_run(self, number: int) -> None:
        self.ask(f"run {number}")

    def end_card(self) -> None:
        self.ask("end card")

    def abort(self) -> None:
        self.ask("abort")

    def replay(self, wish: str) -> None:
        self.ask(f"replay {wish}")

    def answer(self, number: int, word: str) -> None:
        self.ask(f"answer {number} {word}")
        given = list(self.now.answers)
        given[number] = answered(self.now.checklist[number], word, datetime(2026, 11, 23, tzinfo=UTC))
        self.now = replace(self.now, answers=tuple(given))

    def note(self, note: SessionNote) -> None:
        self.ask(f"note {note.text}")
        self.notes.append(note)

    def check(self) -> None:
        self.ask("check")

    def take_over(self) -> None:
        self.ask("take over")

    def choose_card(self, word: str) -> None:
        self.ask(f"card {word}")

    def open_flight(self, *paths: str) -> None:
        self.ask(f"flight {' and '.join(paths)}")

    def fit(self) -> None:
        self.ask("fit")

    def design(self) -> None:
        self.ask("design")

    def push(self, why: str = "") -> None:
        self.ask(f"push because {why}" if why else "push")

    def revert(self) -> None:
        self.ask("revert")

    def fetch_log(self) -> None:
        self.ask("fetch")

    def call_off(self) -> None:
        self.called_off += 1

    def pilot(self, line: str) -> None:
        self.ask(f"pilot {line}")

    def close(self) -> None:
        self.closed.set()


def app_on(state: State, style="braille") -> tuple[TippathApp, FakeWorker]:
    engine = FakeWorker(state)
    return TippathApp(engine, style, bell=False), engine


def screen_text(app: TippathApp) -> list[str]:
    """What a terminal would show."""
    return ["".join(segment.text for segment in strip) for strip in app.screen._compositor.render_strips()]


async def settle(app: TippathApp) -> None:
    """Until what the engine says now stands on the screen, and nothing moves any more."""
    still = 0
    for _ in range(20):  # heights that change with the text, and the bars beside it, are known after the first
        before = _places(app)
        app.look()
        await _drawn(app)
        still = still + 1 if before == _places(app) else 0
        if still == 2:
            break
    app.look()


def _places(app: TippathApp) -> list[tuple[Any, ...]]:
    """Where each text stands, how large what holds it is, and what is shown in it."""
    return [(box.region, box.container_size, box.shown) for box in app.screen.query(Lines)]


async def until(condition: Callable[[], object], within_s: float = PATIENCE_S) -> None:
    """Wait until it is so. Raises TimeoutError after that."""
    async with asyncio.timeout(within_s):
        while not condition():
            await asyncio.sleep(0.02)


async def _drawn(app: TippathApp) -> None:
    """Until the screen on top has been drawn: one that was just left answers no more, so the newest is asked anew."""
    drawn = asyncio.Event()
    async with asyncio.timeout(PATIENCE_S):  # an app that ended does not draw
        while not drawn.is_set():
            app.screen.call_after_refresh(drawn.set)
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(drawn.wait(), 1.0)


async def make_ready(pilot: Pilot[Any], engine: FlightWorker) -> None:
    """R, and again where that was not taken: a busy machine answers late now and then."""
    async with asyncio.timeout(PATIENCE_S):
        while engine.state().stage is not Stage.READY:
            if engine.state().stage is Stage.IDLE:
                await pilot.press("r")
            await asyncio.sleep(1.0)
