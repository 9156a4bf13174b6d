"""Slow modes that no entry of the catalogue has: found where they are, and only there."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest
from strangers.asking import fitted_runs
from strangers.flights import fly

from sysid.data.band import USUAL, swept_band
from sysid.data.dataset import dataset
from sysid.data.record import Record
from sysid.diagnose import diagnose, shares, slow_modes
from sysid.diagnose.candidates import SIGNIFICANT
from sysid.diagnose.evidence import candidate
from sysid.diagnose.slow_modes import SlowMode, slow_mode
from sysid.diagnose.verdict import Diagnosis
from sysid.fit.estimate import estimate
from sysid.fit.identify import on_runs

SWINGING = 10049
"""A training stranger of 13 s chirps below which a load swings; no window of the residual is narrow enough for it."""
IN_BURSTS = 6035
"""Another, in doubled gusts that come in bursts; the load passed for `speed_stability` with others."""
SWINGING_IN_A_LOOP = 4110327
"""Of a judgement, no excitation logged: the load passed for a tilted wake."""
CLEAN_IN_BURSTS, CLEAN_UNLOGGED, CLEAN_SLOW = 3004, 6128, 8279
"""Nothing hidden."""
CLEAN_AND_SHORT = 4190541
"""Nor in this judged one, of 9 s chirps in slow gusts: a mode of 0.5 Hz took up so much of them that it alarmed."""


def flown(seed: int) -> list[Record]:
    return fitted_runs(fly(seed))


def mode_of(runs: list[Record], band_hz: tuple[float, float] | None = None) -> SlowMode | None:
    structure = on_runs("tpp", (), runs, runs)
    on = dataset(runs, band_hz or (swept_band(runs) or USUAL).hz, outputs=structure.outputs)
    parent = candidate(estimate(structure, on.viewed(structure.inputs), weights="constant"), (), on)
    return slow_mode(parent.asked_in(parent.metric), parent.stepped, parent.metric)


def asked(runs: list[Record]) -> Diagnosis:
    band_hz = (swept_band(runs) or USUAL).hz
    return diagnose.diagnose(on_runs("tpp", (), runs, runs), runs, band_hz=band_hz, chains=False)


@pytest.fixture
def well_known(monkeypatch: pytest.MonkeyPatch) -> None:
    """As though all frequencies told how loud noise is."""
    known = SimpleNamespace(gram=lambda rows: rows @ rows.T, surely=lambda *_: math.inf)
    monkeypatch.setattr(slow_modes, "steep", lambda *_: known)


@pytest.mark.parametrize("seed", [SWINGING, IN_BURSTS])
def test_a_load_that_swings_is_found_at_its_frequency(seed: int) -> None:
    found = mode_of(flown(seed))
    assert found is not None
    assert found.log_p < math.log(1e-10)
    assert found.frequency_hz == pytest.approx(fly(seed).hidden.sizes[0]["frequency"], rel=0.12)  # a grid, and bursts


@pytest.mark.parametrize("seed", [CLEAN_IN_BURSTS, CLEAN_UNLOGGED, CLEAN_SLOW, CLEAN_AND_SHORT])
def test_noise_shows_none(seed: int) -> None:
    found = mode_of(flown(seed))
    assert found is not None
    assert found.log_p > math.log(1e-3)


@pytest.mark.usefixtures("well_known")
def test_bursts_of_gusts_are_not_taken_for_one(monkeypatch: pytest.MonkeyPatch) -> None:
    runs = flown(CLEAN_IN_BURSTS)
    monkeypatch.setattr(slow_modes, "_surely", lambda Z, chi_squared, stepped, whitening: chi_squared)
    found = mode_of(runs)
    assert found is not None
    assert found.log_p < math.log(1e-4)


@pytest.mark.usefixtures("well_known")
def test_noise_is_known_by_few_frequencies_where_it_is_slow() -> None:
    found = mode_of(flown(CLEAN_AND_SHORT))
    assert found is not None
    assert found.log_p < math.log(1e-3)


def test_runs_without_slow_frequencies_are_not_asked() -> None:
    assert mode_of(flown(SWINGING), (4.5, 10.0)) is None


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("servo_lag", "attitude_stiffness")], indirect=True)
def test_what_only_a_slow_mode_explains_is_told_and_not_named(monkeypatch: pytest.MonkeyPatch) -> None:
    runs = flown(SWINGING)
    assert asked(runs).verdict == "unexplained"
    monkeypatch.setattr(diagnose, "slow_mode", lambda *_: None)
    assert asked(runs).log_chance > SIGNIFICANT


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("speed_stability", "servo_lag")], indirect=True)
def test_an_entry_beside_which_a_slow_mode_explains_more_only_resembles() -> None:
    found = asked(flown(IN_BURSTS))
    assert found.verdict == "unexplained"
    assert found.outdone


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("slipstream_wing", "attitude_stiffness")], indirect=True)
def test_nor_is_it_named_in_a_loop_that_makes_no_such_mode(monkeypatch: pytest.MonkeyPatch) -> None:
    runs = flown(SWINGING_IN_A_LOOP)
    found = asked(runs)
    assert found.parent.dataset.in_a_loop
    assert (found.verdict, found.reason) == ("unexplained", None)
    assert found.mode is not None
    assert found.mode.frequency_hz == pytest.approx(fly(SWINGING_IN_A_LOOP).hidden.sizes[0]["frequency"], rel=0.12)
    monkeypatch.setattr(shares, "A_LOOP_MAKES", -math.inf)
    assert asked(runs).effect == "slipstream_wing"
