"""What a run is used for, unasked."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gcs.desk.choices import FORWARD, default_base, default_choices, record_of, size_of, word_of
from gcs.desk.state import Base, Choice
from gcs.logs import Run
from sysid.data.record import Record

FIT, VALIDATE, OUT, NOISE = Choice.FIT, Choice.VALIDATE, Choice.OUT, Choice.NOISE


def run(number: int, maneuver: str, axis: str | None, size: float = 0.1, duration_s: float = 30.0, **more: Any) -> Run:
    t = np.arange(0.0, 4.0, 0.01)
    excited = (
        {} if axis is None else {{"roll": "excitation_x", "pitch": "excitation_y"}.get(axis, "excitation_e"): size}
    )
    channels = {"t": t, **{name: np.sin(7 * t) for name in ("p", "q", "delta_x", "delta_y")}}
    channels |= {name: amplitude * np.sqrt(2) * np.sin(7 * t) for name, amplitude in excited.items()}
    record = Record(f"a.BIN#{number}", channels, maneuver=maneuver, axis=axis, path="a.BIN")
    return replace(
        Run(
            record=record,
            id=record.id,
            path="a.BIN",
            maneuver=maneuver,
            axis=axis,
            start_s=0.0,
            duration_s=duration_s,
            rate_hz=100.0,
            gaps=(),
            usable=True,
            reasons=(),
            rate_source="SIDD",
        ),
        **more,
    )


@pytest.mark.parametrize(
    ("runs", "expected"),
    [
        ([("chirp", "roll"), ("chirp", "pitch"), ("doublet", "roll"), ("quiet", None)], [FIT, FIT, VALIDATE, NOISE]),
        # half the amplitude, flown as long: a build-up, and the larger one is fitted
        ([("chirp", "roll", 0.05), ("chirp", "roll", 0.1), ("chirp", "pitch", 0.1)], [VALIDATE, FIT, FIT]),
        # the amplitude that was flown longest
        ([("chirp", "roll", 0.1, 30.0), ("chirp", "roll", 0.2, 10.0), ("chirp", "pitch", 0.2)], [FIT, VALIDATE, FIT]),
        ([("chirp", "roll", 0.1), ("chirp", "roll", 0.11)], [FIT, FIT]),
        # without a chirp there is nothing else to fit
        ([("doublet", "roll"), ("unknown", None), ("quiet", None)], [FIT, FIT, NOISE]),
        ([("chirp", "roll"), ("unknown", None)], [FIT, OUT]),
        ([], []),
    ],
)
def test_each_kind_has_its_use(runs: list[tuple[Any, ...]], expected: list[Choice]) -> None:
    assert default_choices([run(number, *one) for number, one in enumerate(runs, 1)]) == expected


def test_what_cannot_be_used_with_the_others_is_left_out() -> None:
    against = "the sweep's verdict: fly again: gust; named by itself (a.BIN#2) it can still be fitted"
    runs = [
        run(1, "chirp", "roll"),
        run(2, "chirp", "roll", usable=False, reasons=(against,), verdict="fly again: gust"),
        run(3, "chirp", "pitch", usable=False, reasons=("too short",)),
        run(4, "chirp", "pitch"),
        run(5, "chirp", "pitch", rate_source="RATE"),
    ]
    assert default_choices(runs) == [FIT, OUT, OUT, FIT, OUT]
    assert [record_of(one) is not None for one in runs] == [True, True, False, True, True]


def test_yaw_and_thrust_are_left_to_fits_of_their_own() -> None:
    runs = [run(1, "chirp", "roll"), run(2, "chirp", "yaw"), run(3, "chirp", "pitch"), run(4, "doublet", "thrust")]
    assert default_choices(runs) == [FIT, OUT, FIT, OUT]


def test_the_base_follows_what_was_swept() -> None:
    assert default_base([run(1, "chirp", "roll"), run(2, "doublet", "elevator")]) == Base("tpp")
    assert default_base([run(1, "chirp", "elevator")]) == FORWARD
    assert default_base([run(1, "chirp", "elevator", usable=False)]) == Base("tpp")


def test_a_run_is_named_as_commands_take_it() -> None:
    assert word_of(run(3, "chirp", "roll")) == "a.BIN#3"
    assert word_of(replace(run(3, "chirp", "roll"), id="roll", path="runs/roll.npz")) == "runs/roll.npz"


def test_the_size_is_that_of_the_excitation_or_else_of_the_command() -> None:
    assert size_of(run(1, "chirp", "roll", 0.1)) == pytest.approx(0.1, rel=0.02)
    silent = run(1, "chirp", "roll", 0.0)
    assert size_of(silent) == pytest.approx(np.sqrt(0.5), rel=0.02)
    assert size_of(run(1, "quiet", None)) is None
