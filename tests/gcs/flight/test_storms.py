"""Storms over whole flights in fake time: what is claimed is what the vehicle's own log and state say; a dozen of the
hundreds that `make study` flies."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import pytest
from more_of_a_kind import thorough
from storms import (
    FAULTS,
    Outcome,
    Seen,
    Storm,
    Sweep,
    judged_bank,
    judged_log,
    judged_modes,
    judged_parameters,
    judged_runs,
    play,
    random_storm,
)

from sitl.autopilot.modes import Mode
from sitl.faults.script import options

FLOWN = (200, 268, 506, 37, *(4, 9, 14, 19, 24, 44, 49, 54))
"""The first three broke something once; the last eight are pushes."""


@pytest.mark.parametrize("seed", [*FLOWN[:3], *thorough(FLOWN[3:])])
def test_nothing_is_claimed_of_a_storm_that_is_not_so(seed: int, tmp_path: Path) -> None:
    outcome = play(random_storm(seed), tmp_path / "storm")
    assert not outcome.breaches, outcome.told()


def test_a_seed_is_a_storm_and_every_fault_comes_up() -> None:
    storms = [random_storm(seed) for seed in range(400)]
    assert storms == [random_storm(seed) for seed in range(400)]
    assert {storm.kind for storm in storms} == {"card", "telemetry", "push"}
    drawn = {word.partition("=")[0].removeprefix("--") for storm in storms for word in options(storm.script)}
    assert drawn == {*FAULTS, "queue"}


# The judge


RUN = {
    "label": "roll chirp",
    "parameters": {"SID_AXIS": 10.0, "SID_MAGNITUDE": 0.08},
    "log_start_s": 9.0,
    "log_start_within_s": 0.0,
    "verdict": {"keep": True},
    "ending": "finished",
    "mode_after": "Stabilize",
}
LOG = {"path": "flight.BIN", "missing": [], "complete": True, "in_two_versions": 0, "end_cause": "stop"}
CLAIMS: dict[str, Any] = {"log": "stream", "complete": True, "planned": 1, "runs": [RUN], "recording": {"logs": [LOG]}}
SEEN = Seen([Sweep(9.0, 10.0, 0.08, flown=True)], [(1000.0, Mode.STABILIZE), (1014.0, Mode.STABILIZE)])


def outcome(claims: dict[str, Any], said: str = "", status: int = 0) -> Outcome:
    return Outcome(Storm(0, "card", ""), status, said, claims)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("sd/vehicle-1.BIN", "flight/flight.BIN"):
        (tmp_path / name).parent.mkdir()
        (tmp_path / name).write_bytes(bytes(range(200)) * 9)
    return tmp_path


def test_a_true_claim_is_believed(folder: Path) -> None:
    assert judged_log(outcome(CLAIMS), folder) == []
    assert judged_runs(CLAIMS, SEEN) == []
    assert judged_modes(outcome(CLAIMS), SEEN, Mode.STABILIZE, 1030.0) == []


def test_a_log_that_is_not_the_vehicles_is_not_complete(folder: Path) -> None:
    log = folder / "flight" / "flight.BIN"
    log.write_bytes(log.read_bytes()[:-200])
    assert judged_log(outcome(CLAIMS), folder) == ["complete: flight.BIN is not the vehicle's own log"]
    log.write_bytes(bytes(200) + bytes(range(200)) * 8)
    assert len(judged_log(outcome(CLAIMS), folder)) == 2
    holes = copy.deepcopy(CLAIMS)
    holes["complete"] = holes["recording"]["logs"][0]["complete"] = False
    holes["recording"]["logs"][0]["missing"] = [[0, 0]]
    assert judged_log(outcome(holes, status=1), folder) == []
    assert judged_log(outcome(holes), folder) == ["complete: exit status 0 without it"]


@pytest.mark.parametrize(
    "sweep",
    [Sweep(9.0, 10.0, 0.08), Sweep(9.0, 10.0, 0.2, True), Sweep(9.0, 11.0, 0.08, True), Sweep(8, 10, 0.08, True)],
)
def test_a_run_that_was_not_flown_so_is_not_kept(sweep: Sweep) -> None:
    assert judged_runs(CLAIMS, Seen([sweep]))[0].startswith("verdict: roll chirp is kept")


def test_a_vehicle_that_is_left_excited_is_an_end_that_could_have_been_ordered() -> None:
    excited = Seen(SEEN.sweeps, [(1000.0, Mode.STABILIZE), (1009.0, Mode.SYSTEMID)])
    silent = outcome({**CLAIMS, "runs": [{**RUN, "mode_after": "unknown"}]}, status=1)
    assert judged_modes(silent, excited, Mode.SYSTEMID, 1050.0) == ["end: left in the excitation, and not a word"]
    told = outcome(silent.claims, "the pilot must take it", 1)
    assert judged_modes(told, excited, Mode.SYSTEMID, 1050.0) == []
    excited.beats += [(at, int(Mode.SYSTEMID)) for at in (1016.0, 1017.0, 1018.0)]
    assert judged_modes(told, excited, Mode.SYSTEMID, 1050.0) == []
    excited.delivered.append(1019.0)
    assert judged_modes(told, excited, Mode.SYSTEMID, 1050.0)[0].startswith("end: left in the excitation, 3 heartbeats")


def test_parameters_and_banks_are_as_they_are_said_to_be() -> None:
    before, after = {"SID_AXIS": 0.0}, {"SID_AXIS": 10.0}
    assert judged_parameters(before, after, set(), "") == ["parameters: SID_AXIS not as found, and not a word"]
    assert judged_parameters(before, after, {"SID_AXIS"}, "") == []
    assert judged_parameters(before, after, set(), "the maneuver's parameters stay in the vehicle") == []
    old, new, mixed = (1.0, 1.0), (2.0, 2.0), (1.0, 2.0)
    assert judged_bank(old, new, new, outcome({})) == []
    assert judged_bank(old, mixed, new, outcome({}, status=1)) == ["push: the active bank is a mixture"]
    assert judged_bank(old, old, new, outcome({})) == ["push: exit status 0, and the set does not fly"]
    denied = outcome({}, "nothing was committed", 1)
    assert judged_bank(old, new, new, denied) == ["push: it flies, and is said not to"]
