"""Validation runs that log less than the fitted ones, or move other commands than roll and pitch."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from planted import fly_many
from planted_fits import records
from scipy.signal import cont2discrete, lfilter

import sysid
from sysid.data.dataset import Dataset
from sysid.data.record import Record
from sysid.diagnose.diagnose import diagnose
from sysid.diagnose.thinned import telling
from sysid.errors import FitError
from sysid.fit.identify import on_runs

BAND_HZ = (0.3, 10.0)
DT = 0.002


@pytest.fixture(scope="module")
def flight() -> list[Record]:
    return records(fly_many(None, {}, seeds=[17], duration_s=8.0)[0])


def with_rotor_speed(run: Record) -> Record:
    t = run.t - run.t[0]
    return replace(run, channels={**run.channels, "omega": 170.0 + 8.0 * np.sin(0.7 * t)})


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("rotor_speed", "servo_lag")], indirect=True)
def test_a_signal_that_judging_runs_do_not_log_is_not_asked_of(flight: list[Record]) -> None:
    *fitted, judge = map(with_rotor_speed, flight)
    structure = on_runs("tpp", (), fitted, fitted)
    asked = {one.effect: one.not_testable for one in diagnose(structure, fitted, [judge], BAND_HZ).candidates}
    assert asked["rotor_speed"] is None
    without = diagnose(structure, fitted, [judge.without(["omega"])], BAND_HZ)
    told = {one.effect: one.not_testable for one in without.candidates}
    assert told["servo_lag"] is None
    assert "omega is not logged on every run" in str(told["rotor_speed"])


def test_a_fit_that_reads_such_a_signal_is_refused_by_name(flight: list[Record]) -> None:
    *fitted, judge = map(with_rotor_speed, flight)
    structure = on_runs("tpp", ("rotor_speed",), fitted, fitted)
    with pytest.raises(FitError, match="omega is not logged on every validation run"):
        diagnose(structure, fitted, [judge.without(["omega"])], BAND_HZ)


def yawing(every: int, command: str = "chirp") -> Record:
    """Yaw of first order, logged at every so many samples of a loop that nobody told of; roll and pitch rest."""
    t = DT * np.arange(10000)
    chirp = 0.1 * np.sin(2 * np.pi * (0.3 * t + 0.2 * t**2)) * (t < 19)
    steps = 0.1 * np.sign(np.sin(2 * np.pi * 0.37 * t)) * (t < 19)
    moved = chirp if command == "chirp" else steps
    num, den, _ = cont2discrete(([50.0], [1.0, 3.0]), DT, "zoh")
    answer = lfilter(np.ravel(num), den, moved)
    r = answer + 0.03 * np.std(answer) * np.random.default_rng(every).standard_normal(t.size)
    channels = {"t": t, "r": r, "delta_r": moved, "delta_x": 0 * t, "delta_y": 0 * t, "p": 0 * t, "q": 0 * t}
    return Record(command, {name: one[::every] for name, one in channels.items()}, maneuver="chirp", axis="yaw")


def test_yaw_is_validated_by_slow_logs_too() -> None:
    fast, slow = yawing(1), yawing(5)
    fit = sysid.fit_model([fast], "yaw", band_hz=BAND_HZ)
    found = sysid.diagnose_fit(fit, [fast], [slow])
    assert found.verdict == "complete"
    assert found.validation_nrmse_percent is not None


@pytest.mark.parametrize(("command", "judges"), [("chirp", True), ("steps", False)])
def test_whether_a_slow_log_judges_yaw_hangs_on_its_own_command(command: str, judges: bool) -> None:
    runs = Dataset(records=(yawing(10, command),), band_hz=BAND_HZ, outputs=("r",))
    assert (telling(runs) is not None) == judges
