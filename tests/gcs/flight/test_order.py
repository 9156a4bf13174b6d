"""Which run of a card is next: repeated, skipped, chosen; in fake time, with what the vehicle was asked."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from fake_flight import PARAMETERS, SYSTEMID, FakeSession, FakeVehicle

from gcs.cards.envelope import Limits
from gcs.cards.maneuver import Maneuver, Step, TestCard, card_text
from gcs.flight.flown_card import SweepResult
from gcs.flight.folder import FlightFolder, create
from gcs.flight.order import Choosing
from gcs.flight.run import Note, Progress, RunProgress, RunReady, RunResult
from gcs.flight.run_state import Ending, Phase
from gcs.flight.sweep import fly_card

STABILIZE, ALT_HOLD = 0, 2
OFTEN = 3
"""So often the operator goes on."""
ROLL = Maneuver(kind="chirp", axis="roll", amplitude=0.1, duration_s=10.0)
PITCH = Maneuver(kind="chirp", axis="pitch", amplitude=0.1, duration_s=10.0)
DOUBLET = Maneuver(kind="doublet", axis="pitch", amplitude=0.1, duration_s=3.0, pulse_s=0.25)


class Operator:
    """Wishes and aborts by a script, and writes down which runs were ready and flown."""

    def __init__(
        self, *, wishes: dict[int, int] | None = None, aborts: tuple[int, ...] = (), again: bool = True
    ) -> None:
        """`wishes`: how often a run had been ready -> the number that is wished for then; `aborts`: tries, from 1, that
        are aborted in mid-run."""
        self.wishes, self.aborts, self.goes_on = wishes or {}, aborts, again
        self.ready: list[int] = []
        self.flown: list[int] = []
        self.notes: list[str] = []
        self.asked: list[Ending] = []
        self._abort: str | None = None

    def chosen(self) -> int | None:
        return self.wishes.pop(len(self.ready), None)

    def again(self, result: RunResult) -> bool:
        self.asked.append(result.ending)
        self._abort = None
        return self.goes_on and len(self.asked) <= OFTEN

    def blind(self) -> bool:
        return False

    def aborted(self) -> str | None:
        return self._abort

    def hears(self, progress: Progress) -> None:
        match progress:
            case RunReady():
                self.ready.append(progress.run.number)
            case RunProgress() if progress.phase is Phase.FLYING and progress.elapsed_s > 1:
                if len(self.flown) + 1 in self.aborts:
                    self._abort = "F12"
            case RunResult():
                self.flown.append(progress.run.number)
            case Note():
                self.notes.append(progress.words)


@pytest.fixture
def vehicle() -> FakeVehicle:
    return FakeVehicle()


@pytest.fixture
def folder(tmp_path: Path) -> FlightFolder:
    return create(tmp_path / "flight")


def fly(
    vehicle: FakeVehicle, folder: FlightFolder, operator: Operator, *maneuvers: Maneuver, **more: Any
) -> SweepResult:
    session = FakeSession(vehicle)
    card = TestCard(name="test", maneuvers=maneuvers, steps=more.pop("steps", ()))
    card = replace(card, text=card_text(card))
    choosing: Choosing = operator
    return fly_card(
        session,
        card,
        folder=folder,
        clock=session,
        disk_free=lambda _: 10**12,
        on_progress=operator.hears,
        aborted=operator.aborted,
        choosing=choosing,
        **more,
    )


def never_written_while_excited(vehicle: FakeVehicle) -> bool:
    return not any(mode == SYSTEMID for *_, mode in vehicle.written)


def test_a_run_that_was_aborted_waits_to_be_flown_again(vehicle: FakeVehicle, folder: FlightFolder) -> None:
    operator = Operator(aborts=(1,))
    result = fly(vehicle, folder, operator, ROLL, PITCH)
    assert operator.flown == [1, 1, 2]
    assert operator.ready == [1, 1, 2], "it is made ready anew, and waits for its own start"
    assert operator.asked == [Ending.ABORTED]
    assert [mode for _, mode in vehicle.asked] == [SYSTEMID, STABILIZE] * 3
    assert never_written_while_excited(vehicle)
    assert vehicle.parameters == PARAMETERS
    assert result.complete
    assert (result.kept, result.tried, result.planned) == (2, 2, 2)
    assert result.missing_words == "0 samples missing", "what the aborted try has not is flown by now"
    entries = json.loads(folder.about.read_text())["runs"]
    assert [(entry["number"], entry["ending"]) for entry in entries] == [
        (1, "aborted"),
        (1, "finished"),
        (2, "finished"),
    ]


def test_who_does_not_go_on_ends_the_card(vehicle: FakeVehicle, folder: FlightFolder) -> None:
    operator = Operator(aborts=(1,), again=False)
    result = fly(vehicle, folder, operator, ROLL, PITCH)
    assert operator.flown == [1]
    assert result.stopped == "roll chirp aborted; F12"
    assert not result.flown


def test_a_limit_ends_the_run_and_not_the_card(vehicle: FakeVehicle, folder: FlightFolder) -> None:
    operator = Operator(wishes={2: 2})
    result = fly(vehicle, folder, operator, ROLL, DOUBLET, limits=Limits(rate=0.2))
    assert operator.asked[0] is Ending.LIMIT
    assert operator.ready[:3] == [1, 1, 2], "the run again, unless another is wished for"
    assert len(operator.asked) == OFTEN + 1
    assert not result.complete
    assert never_written_while_excited(vehicle)


def test_a_pilot_who_takes_over_is_not_asked_whether_the_card_goes_on(
    vehicle: FakeVehicle, folder: FlightFolder
) -> None:
    operator = Operator()
    vehicle.in_sweep(4.0, lambda: vehicle.pilot(ALT_HOLD))
    result = fly(vehicle, folder, operator, ROLL, PITCH)
    assert operator.asked == []
    assert result.ending is Ending.PILOT
    assert [mode for _, mode in vehicle.asked] == [SYSTEMID], "nothing but the start was ever commanded"


def test_a_run_is_skipped_and_comes_up_once_more(vehicle: FakeVehicle, folder: FlightFolder) -> None:
    operator = Operator(wishes={1: 2})
    result = fly(vehicle, folder, operator, ROLL, PITCH, DOUBLET)
    assert operator.ready == [1, 2, 3, 1]
    assert operator.flown == [2, 3, 1]
    assert result.complete


def test_a_run_that_was_kept_is_flown_once_more_where_it_is_wished_for(
    vehicle: FakeVehicle, folder: FlightFolder
) -> None:
    operator = Operator(wishes={2: 1})
    result = fly(vehicle, folder, operator, ROLL, PITCH)
    assert operator.flown == [1, 1, 2]
    assert result.complete
    assert result.kept == 2


def test_a_locked_step_is_not_chosen(vehicle: FakeVehicle, folder: FlightFolder) -> None:
    operator = Operator(wishes={1: 2, 2: 99})
    fly(vehicle, folder, operator, ROLL, steps=(Step(0.5),))
    assert operator.notes[0].startswith("run 2: roll chirp stays locked: how far the step before")
    assert operator.notes[1] == "run 99: it cannot be flown now"
    assert operator.ready[:3] == [1, 1, 1]
    assert operator.flown == [1, 2]


def test_probes_come_first_whatever_is_wished_for(vehicle: FakeVehicle, folder: FlightFolder) -> None:
    operator = Operator(wishes={1: 4})
    fly(vehicle, folder, operator, ROLL, PITCH, probe=True)
    assert operator.notes[0] == "run 4: it cannot be flown now"
    assert operator.flown[:2] == [1, 2]
