"""Every screen as text, beside what it was: `TIPPATH_SNAPSHOTS=write` in the environment writes them anew."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import pytest
from fake_app import CHECKED, FLYING, IDLE, app_on, screen_text, settle
from fake_desk import DESKS
from more_of_a_kind import thorough

from gcs.tui.connections import NOWHERE, SIMULATED, UDP, Connection
from gcs.tui.state import State, joined

KEPT = Path(__file__).parent / "snapshots"
WRITE = os.environ.get("TIPPATH_SNAPSHOTS") == "write"
FLOWN = replace(IDLE, flight=Path("flight-0007"), station=255)


def after(moment: str) -> State:
    return joined(FLOWN, DESKS[moment])


SHOTS = {
    "connect": ("1", FLOWN, ""),
    "check": ("c", replace(CHECKED, link="/dev/ttyUSB0,57600"), ""),
    "fly": ("2", FLYING, ""),
    "runs": ("3", after("open"), ""),
    "fit": ("4", after("compared"), ""),
    "fit-strips": ("4", after("compared"), "v"),
    "compare": ("5", after("compared"), ""),
    "compare-response": ("5", after("compared"), "vv"),
    "diagnosing": ("6", after("asking"), ""),
    "diagnose": ("6", after("asked"), ""),
    "ladder": ("7", after("added"), ""),
    "controller": ("8", after("designed"), ""),
    "report": ("9", after("reported"), ""),
    "help": ("question_mark", FLOWN, ""),
    "palette": ("2", FLOWN, ("ctrl+p", "f", "i", "t")),
}


class Connections:
    """Ports that every computer has."""

    connection = SIMULATED[0]

    def connections(self) -> tuple[Connection, ...]:
        return (
            UDP,
            Connection(name="/dev/ttyUSB0,57600", about="a radio [/]", link="/dev/ttyUSB0,57600"),
            *SIMULATED,
            NOWHERE,
        )

    def connect(self, connection: Connection) -> None:
        raise AssertionError("nobody asked for it")


@pytest.mark.parametrize("size", [*thorough([((80, 24),)]), (120, 40)], ids=["80x24", "120x40"])
async def test_screens_look_as_they_did(size):
    app, engine = app_on(FLOWN)
    app.connections = Connections()
    changed = []
    async with app.run_test(size=size) as pilot:
        await app.workers.wait_for_complete()
        for name, (key, state, more) in SHOTS.items():
            engine.now = state
            await pilot.press(key, *more)
            await settle(app)
            text = "\n".join(line.rstrip() for line in screen_text(app)) + "\n"
            path = KEPT / f"{name}-{size[0]}x{size[1]}.txt"
            if WRITE:
                KEPT.mkdir(exist_ok=True)
                path.write_text(text, "utf-8")
            elif not path.exists() or path.read_text("utf-8") != text:
                changed.append(f"{path.name}\n{text}")
    assert not changed, "look at these, then run with TIPPATH_SNAPSHOTS=write:\n" + "\n".join(changed)
