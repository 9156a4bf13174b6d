"""Chirps by their law, against those that others wrote; and excitations rebuilt where nobody logged them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import planted
import pytest
from planted_fits import in_standard_errors, records

from sitl.autopilot.excitation import Excitation, ExcitationSettings
from sysid.data.chirp import Chirp, placed, with_excitation
from sysid.data.record import Record
from sysid.fit.identify import identify
from sysid.model.paper import TPP

TABLE_1 = Chirp(axis="roll", law="tischler", f_start_hz=0.5, f_stop_hz=10.0, duration_s=12.0)
FADED = replace(TABLE_1, law="ardupilot", fade_in_s=2.0, fade_out_s=1.5)
EXCITATIONS = ("excitation_x", "excitation_y", "excitation_e")


@pytest.mark.parametrize("chirp", [TABLE_1, FADED, replace(TABLE_1, c1=2.5)], ids=["table 1", "ardupilot", "c1"])
def test_the_wave_is_what_the_vehicle_flies(chirp: Chirp) -> None:
    settings = ExcitationSettings(
        kind="chirp",
        law=chirp.law,
        axis="roll",
        magnitude=1.0,
        duration_s=chirp.duration_s,
        fade_in_s=chirp.fade_in_s,
        fade_out_s=chirp.fade_out_s,
        c1=chirp.c1,
        noise=0.0,
    )
    flying = Excitation(settings, seed=1)
    flown = np.array([flying.step().target for _ in range(6000)])
    times = np.linspace(0.0, 12.0, 6000, endpoint=False) + 1e-9
    assert np.max(np.abs(chirp.wave(times) - flown)) < 1e-6


def test_nothing_is_flown_before_and_after() -> None:
    t = np.array([-0.1, -1e-6, 12.0, 13.0])
    assert not np.any(TABLE_1.wave(t))
    assert not np.any(replace(TABLE_1, flown_s=5.0).wave(np.array([5.0, 8.0])))


@pytest.mark.parametrize(
    "change",
    [
        {"f_start_hz": 0.0},
        {"f_stop_hz": 0.4},
        {"duration_s": 0.0},
        {"law": "ardupilot", "duration_s": 3.9},
        {"axis": "yaw"},
        {"c1": 60.0},
        {"fade_in_s": float("nan")},
    ],
    ids=str,
)
def test_what_is_no_chirp_makes_no_sense(change: Mapping[str, Any]) -> None:
    assert TABLE_1.makes_sense
    assert not replace(TABLE_1, **change).makes_sense


@pytest.fixture(scope="module")
def flights() -> list[list[planted.Run]]:
    return planted.fly_many(None, {}, seeds=range(4), duration_s=12.0, gusts=2.0)


def test_the_start_is_found_within_milliseconds(flights: Sequence[Sequence[planted.Run]]) -> None:
    off, errors = [], []
    for flight in flights:
        for number, run in enumerate(flight):
            axis = planted.axes(False)[number]
            command = run["delta_x" if axis == "roll" else "delta_y"]
            place = placed(replace(TABLE_1, axis=axis), run["t"], command, planted.REST_S + 0.13, 0.3)
            assert place is not None
            off.append(place.start_s - planted.REST_S)
            errors.append(place.error_s)
            assert place.share > 0.5
            assert place.amplitude == pytest.approx(planted.SIZES[axis], rel=0.2)
    assert np.max(np.abs(off)) < 0.008  # feedback adds to the command a little later
    assert np.all(np.abs(off) < np.array(errors))
    assert np.max(errors) < 0.03


def test_what_the_command_does_not_show_is_not_believed(flights: Sequence[Sequence[planted.Run]]) -> None:
    run = flights[0][0]
    gusts = np.cumsum(np.random.default_rng(1).standard_normal(run["t"].size)) * 1e-3
    assert placed(TABLE_1, run["t"], gusts, planted.REST_S, 0.2) is None
    assert placed(TABLE_1, run["t"], run["delta_x"], planted.REST_S + 0.5, 0.2) is None
    assert placed(TABLE_1, run["t"], run["delta_x"], 400.0, 0.2) is None


def rebuilt(flight: Sequence[planted.Run]) -> list[Record]:
    found = []
    for number, record in enumerate(records(flight, *EXCITATIONS)):
        chirp = replace(TABLE_1, axis=planted.axes(False)[number])
        again = with_excitation(record, chirp, planted.REST_S - 0.1, 0.3, "SIDS")
        assert again is not None
        found.append(again)
    return found


def test_a_rebuilt_excitation_is_the_instrument_that_a_logged_one_is(
    flights: Sequence[Sequence[planted.Run]],
) -> None:
    for flight in flights[:2]:
        logged, again = identify(TPP, records(flight)), identify(TPP, rebuilt(flight))
        assert (logged.instrument, again.instrument) == ("excitation logged", "excitation rebuilt")
        apart = np.abs(again.model.values - logged.model.values) / logged.standard_errors
        assert np.max(apart) < 1.5
        assert max(map(abs, in_standard_errors(again, planted.TABLE_4).values())) < 4
        np.testing.assert_allclose(again.standard_errors, logged.standard_errors, rtol=0.35)


def test_a_record_says_what_it_was_rebuilt_from(flights: Sequence[Sequence[planted.Run]]) -> None:
    record = rebuilt(flights[0])[1]
    assert record.excitation_from == "SIDS"
    assert record.notes[-1].startswith("excitation rebuilt from SIDS: from 0.99")
    assert record.notes[-1].endswith("% of delta_y")
    assert np.any(record.channels["excitation_y"])
    assert not np.any(record.channels["excitation_x"])
