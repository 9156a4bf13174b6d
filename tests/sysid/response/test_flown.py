"""Measured responses and their bounds, beside SciPy's spectra and beside what a known vehicle answers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from scipy.signal import csd
from swept_loops import DT, SWEPT_HZ, sweeps, truth

from sysid.data.record import Record
from sysid.response.flown import FlownResponses, Kept, NoResponseError, Why, flown_responses
from sysid.response.values import Responses

FEW = 12
"""Points of the grid: tests of many flights want no more."""


def records(runs: Sequence[dict[str, np.ndarray]], *, excitation: bool = True) -> list[Record]:
    return [
        Record(
            f"#{i}",
            {name: x for name, x in run.items() if excitation or not name.startswith("excitation")},
            maneuver="chirp",
            axis="roll" if np.any(run["excitation_x"]) else "pitch",
            swept_band_hz=SWEPT_HZ,
        )
        for i, run in enumerate(runs)
    ]


def flown(runs: Sequence[dict[str, np.ndarray]], *, excitation: bool = True, points: int = FEW) -> FlownResponses:
    return flown_responses(records(runs, excitation=excitation), SWEPT_HZ, points=points)


def by_csd(runs: Sequence[dict[str, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Two inputs at once by SciPy's cross spectra, summed over the runs, solved by hand; the hold taken out."""
    size = 2048

    def spectra(a: str, b: str) -> np.ndarray:
        return sum(csd(run[a], run[b], 1 / DT, "hann", size, size * 3 // 4, detrend=False)[1] for run in runs)

    frequency = np.fft.rfftfreq(size, DT)
    inputs, outputs = ("delta_x", "delta_y"), ("p", "q")
    S_uu = np.array([[spectra(b, a) for b in inputs] for a in inputs])
    S_yu = np.array([[spectra(u, y) for u in inputs] for y in outputs])
    (a, b), (c, d) = S_uu
    inverse = np.array([[d, -b], [-c, a]]) / (a * d - b * c)
    held = np.exp(-1j * np.pi * frequency * DT) * np.sinc(frequency * DT)
    return frequency, np.einsum("kmf,mnf->knf", S_yu, inverse) / held


def test_as_cross_spectra_solved_by_hand_on_clean_data() -> None:
    (runs,) = sweeps(1, seconds=122.0)
    found = flown(runs, points=30).responses
    frequency, H = by_csd(runs)
    independent = np.array([[np.interp(found.frequency_hz, frequency, one) for one in row] for row in H])
    # SciPy's windows lean where the sweep begins and ends, ours do not: the next test
    inside = (found.frequency_hz > 0.7) & (found.frequency_hz < 8)
    clear = (found.partial_coherence > 0.8) & inside
    assert clear.mean() > 0.7
    apart = (found.H / independent)[clear]
    assert np.max(np.abs(20 * np.log10(np.abs(apart)))) < 0.1
    assert np.max(np.abs(np.degrees(np.angle(apart)))) < 1.0


def test_as_the_vehicle_answers_on_clean_data() -> None:
    (runs,) = sweeps(1, seconds=62.0)
    found = flown(runs, points=30).responses
    error = (found.H / truth(found.frequency_hz))[found.trusted]
    assert found.trusted.all()
    assert np.sqrt(np.mean((20 * np.log10(np.abs(error))) ** 2)) < 0.1
    assert np.sqrt(np.mean(np.degrees(np.angle(error)) ** 2)) < 1.0


@pytest.fixture(scope="module")
def gusty() -> list[list[dict[str, np.ndarray]]]:
    """30 flights of strong feedback in gusts that hide a fifth of what is to be measured."""
    return sweeps(30, gusts=0.15, feedback=2.0)


def errors(of: Sequence[Responses]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Error over its own measure, relative error, and where trusted; flights first."""
    T = truth(of[0].frequency_hz)
    z = np.array([(one.H - T) / one.error for one in of])
    return z, np.array([one.H / T - 1 for one in of]), np.array([one.trusted for one in of])


def test_bounds_hold_as_often_as_they_say(gusty: list[list[dict[str, np.ndarray]]]) -> None:
    found = [flown(runs).responses for runs in gusty]
    z, _, trusted = errors(found)
    assert trusted.mean() > 0.6
    assert 0.8 < np.sqrt(np.mean(np.abs(z[trusted]) ** 2)) < 1.1
    T = truth(found[0].frequency_hz)
    inside = [np.abs(one.decibels - 20 * np.log10(np.abs(T))) <= one.bound_db for one in found]
    assert 0.93 < np.mean(np.array(inside)[trusted]) < 0.995


def test_the_excitation_keeps_out_what_feedback_makes(gusty: list[list[dict[str, np.ndarray]]]) -> None:
    """Against the commands themselves the same flights lean, all to the same side."""
    leans = []
    for excitation in (True, False):
        found = [flown(runs, excitation=excitation) for runs in gusty[:15]]
        assert found[0].kept("delta_x") is (Kept.LOGGED if excitation else Kept.NOTHING)
        z, _, trusted = errors([one.responses for one in found])
        often = trusted.mean(axis=0) > 0.8
        leans.append(np.sqrt(np.mean(np.abs(z.mean(axis=0)[often]) ** 2)) * np.sqrt(len(found)))
    assert leans[0] < 1.6  # one by chance; blur is all to one side
    assert leans[1] > 2 * leans[0]


def test_one_axis_alone_is_refused_with_what_to_do() -> None:
    (runs,) = sweeps(1, axes=(0,))
    for excitation in (True, False):
        found = flown(runs, excitation=excitation)
        assert {found.why_not(*pair) for pair in found.pairs} == {Why.FOLLOWS}
        assert found.not_swept == ("pitch",)
    alone = flown_responses(records(runs), SWEPT_HZ, inputs=("delta_x",), points=FEW)
    assert alone.why_not("p", "delta_x") is None


def test_a_command_that_rests_is_no_input() -> None:
    (runs,) = sweeps(1, axes=(0,), feedback=0.0)
    found = flown(runs)
    assert found.responses.commands == ("delta_x",)
    valid = found.responses.valid_hz("q", "delta_x")
    assert valid is not None
    assert valid[1] > 8


def test_a_third_command_is_an_input_where_it_moves_as_much() -> None:
    (runs,) = sweeps(1, seconds=12.0)
    rng = np.random.default_rng(3)
    noise = rng.normal(size=runs[0]["t"].size)
    for size, inputs in ((0.002, ("delta_x", "delta_y")), (0.05, ("delta_x", "delta_y", "delta_e"))):
        found = flown_responses(
            [Record(one.id, {**one.channels, "delta_e": size * noise}) for one in records(runs)], SWEPT_HZ, points=3
        )
        assert found.responses.commands == inputs


def test_no_answer_is_told_from_no_sweep() -> None:
    (runs,) = sweeps(1, feedback=0.0)
    rng = np.random.default_rng(1)
    runs = [{**run, "q": rng.normal(size=run["t"].size)} for run in runs]
    found = flown(runs)
    assert found.why_not("q", "delta_x") is Why.FAINT
    assert found.why_not("p", "delta_x") is None


def test_a_rebuilt_excitation_is_told() -> None:
    (runs,) = sweeps(1)
    rebuilt = [
        Record(one.id, one.channels, maneuver="chirp", axis=one.axis, excitation_from="SIDS") for one in records(runs)
    ]
    assert flown_responses(rebuilt, SWEPT_HZ, points=FEW).kept("delta_y") is Kept.REBUILT


def test_a_thinned_log_shows_the_same_vehicle() -> None:
    """Every fifth sample of a log, its loop's rate known: what the loop's hold does is taken out, not the log's."""
    (runs,) = sweeps(1, seconds=62.0)
    thinned = [
        Record(
            one.id,
            {name: x[::4] for name, x in one.channels.items()},
            maneuver="chirp",
            axis=one.axis,
            swept_band_hz=SWEPT_HZ,
            loop_dt_s=DT,
        )
        for one in records(runs)
    ]
    found = flown_responses(thinned, (0.5, 5.0), points=FEW).responses
    phase = np.degrees(np.angle(found.H / truth(found.frequency_hz)))[found.trusted]
    assert np.sqrt(np.mean(phase**2)) < 1.0  # the log's hold is 27 degrees more at 5 Hz


@pytest.mark.parametrize(
    ("inputs", "outputs", "words"),
    [
        (("p",), ("p",), "p is no command"),
        (("delta_e",), ("p",), "delta_e is not logged"),
        ((), ("r",), "r is not logged"),
    ],
)
def test_what_is_not_there_is_refused(inputs: tuple[str, ...], outputs: tuple[str, ...], words: str) -> None:
    (runs,) = sweeps(1, seconds=12.0)
    with pytest.raises(NoResponseError, match=words):
        flown_responses(records(runs), SWEPT_HZ, inputs, outputs)


def test_runs_in_which_nothing_moves_are_refused() -> None:
    (runs,) = sweeps(1, seconds=12.0)
    still = [{**run, "delta_x": 0 * run["t"], "delta_y": 0 * run["t"]} for run in runs]
    with pytest.raises(NoResponseError, match="no command moves"):
        flown(still)
    with pytest.raises(NoResponseError, match="does not move in these runs"):
        flown_responses(records(still), SWEPT_HZ, ("delta_x",))
    short = [{name: x[:150] for name, x in run.items()} for run in runs]
    with pytest.raises(NoResponseError, match="shorter than 2 s"):
        flown(short)
