"""A slow log that does not tell its loop, hiding a delay: how commands were held goes from the answer into the fits."""

from __future__ import annotations

from functools import cache

import planted
import pytest

from gcs.analysis.addition import Addition, add_effect
from gcs.analysis.diagnosis import diagnose_fit
from gcs.analysis.fits import assess, identify_flight
from sysid.data.band import BandFrom, ChosenBand
from sysid.data.record import Record
from sysid.fit.identify import identify
from sysid.fit.result import Fit
from sysid.model.compose import compose
from sysid.model.effect import find

BAND = (0.3, 12.0)
DELAY_S = 0.009
EVERY = 10
"""Samples of the loop, 500 Hz, for one in the log."""

asked = pytest.mark.parametrize("only_effects", [["transport_delay", "hub_gyroscopics"]], indirect=True)


@cache
def logged(delay_s: float) -> list[Record]:
    flown = planted.fly("transport_delay", {"T_d": delay_s}, seed=1) if delay_s else planted.fly(None, {}, seed=1)
    channels = ("t", "p", "q", "delta_x", "delta_y", "excitation_x", "excitation_y")
    return [
        Record(f"#{number}", {name: run[name][::EVERY] for name in channels}, maneuver="chirp", axis=axis)
        for number, (run, axis) in enumerate(zip(flown, planted.axes(False), strict=True))
    ]


@cache
def bare() -> Fit:
    return identify(compose("tpp"), logged(DELAY_S), band_hz=BAND)


def delay_of(fit: Fit) -> float:
    return fit.model["T_d"]


def test_beside_a_delay_no_loop_shows() -> None:
    assert bare().found_loop_s is None


@pytest.mark.thorough
@asked
@pytest.mark.usefixtures("only_effects")
def test_the_added_delay_is_the_one_that_was_named() -> None:
    found = diagnose_fit(bare(), logged(DELAY_S), repeat=True)
    assert found.rungs[0].effects == ()
    assert found.last.verdict == "complete"
    assert delay_of(found.fit) == pytest.approx(DELAY_S, abs=0.0006)
    assert found.fit.found_loop_s == pytest.approx(1 / 400)


@asked
@pytest.mark.usefixtures("only_effects")
def test_what_is_added_stands_beside_the_fit_without_it_on_the_same_runs() -> None:
    added: Addition = add_effect(bare(), find("transport_delay"), logged(DELAY_S))
    assert delay_of(added.after) == pytest.approx(DELAY_S, abs=0.0006)
    assert added.before.found_loop_s == added.after.found_loop_s == pytest.approx(1 / 400)
    assert min(added.after.nrmse_percent.values()) > max(added.before.nrmse_percent.values())


def test_two_bases_of_a_flight_take_the_loop_alike_and_are_judged_so() -> None:
    found = identify_flight(logged(0.0), band=ChosenBand(BAND, BandFrom.GIVEN))
    assert found.tpp.found_loop_s == pytest.approx(0.002, abs=4e-4)
    assert found.cd.found_loop_s == pytest.approx(found.tpp.found_loop_s)
    raw, held = (assess(found.tpp, runs) for runs in (logged(0.0), [one.held(0.0021) for one in logged(0.0)]))
    names = {check.name for one in (raw, held) for check in one.checks}
    assert "time of commands" not in names, "it is taken as such already"
