"""Where a response that is not linear, or wanders with time, must settle."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from more_of_a_kind import thorough
from planted import TABLE_4, fly
from strangers.asking import records
from strangers.flights import fly as fly_stranger

from sysid.data.dataset import dataset
from sysid.data.preprocess import ComplexArray
from sysid.data.record import Record
from sysid.data.stacks import Stack
from sysid.model import relaxation
from sysid.model.compose import compose
from sysid.model.predict import respond

WANDERING = {"k": 1.0, "n": 0.6}
SEED = 5120
"""A training one, whose short doublets hardly move the wake."""


def responses(effects: list[str], groups: Sequence[Stack], values: dict[str, float]) -> list[ComplexArray]:
    structure = compose("tpp", effects, ("omega",), {"Omega_0": 172.0})
    return [respond(structure, structure.vector(values), group, False).Y for group in groups]


def test_where_a_filter_of_the_gyros_began_does_not_matter_to_the_rates() -> None:
    """No rate tells its end states, which a wandering rotor speed made anything: nothing settled."""
    runs = fly(None, {}, seed=4, duration_s=15.0)
    turning = 172.0 * (1 + 0.1 * np.sin(np.arange(runs[0]["p"].size) * 0.004))
    flown = [Record(f"#{i}", {**run, "omega": turning}) for i, run in enumerate(runs)]
    groups = dataset(flown, (0.3, 10.0)).stacks
    values = {**TABLE_4, **WANDERING}
    for corner, zeta in ((48.0, 0.65), (400.0, 0.7)):
        found = responses(["rotor_speed", "gyro_filter"], groups, {**values, "corner": corner, "zeta": zeta})
        plain = responses(["rotor_speed"], groups, values)
        for own, unfiltered, group in zip(found, plain, groups, strict=True):
            s = 1j * group.frequency_hz / corner
            behind = unfiltered / (1 + 2 * zeta * s + s**2)
            assert np.linalg.norm(own - behind) < 0.01 * np.linalg.norm(behind)


@pytest.mark.parametrize("apart", [0.0, 1e-12, 1e-6, 1.0])
def test_a_linear_part_of_equal_poles_answers_as_bin_by_bin(apart: float) -> None:
    flown = [Record(f"#{i}", run) for i, run in enumerate(fly(None, {}, seed=4, duration_s=8.0))]
    (group,) = dataset(flown, (0.3, 10.0)).stacks
    run = relaxation._Run(compose("cd", []), group.spectra[0])
    A = np.array([[-3.0, 20.0, 0.0], [0.0, -3.0 - apart, 0.0], [1.0, 0.0, 0.0]])
    rates = np.random.default_rng(5).normal(size=(3, run.bins)) + 0j
    plain = np.linalg.solve(run.s[1:, None, None] * np.eye(3) - A, rates[:, 1:].T[..., None])[..., 0].T
    found = run.transfer(A)
    assert np.max(np.abs(found.through(rates)[:, 1:] - plain)) < 1e-5 * np.max(np.abs(plain))
    assert not np.any(found.through(rates)[:, 0])
    from_ends = np.linalg.inv(run.s[run.inside, None, None] * np.eye(3) - A).transpose(2, 1, 0)[:, [0, 2]]
    assert np.max(np.abs(found.ends([0, 2], run.inside) - from_ends)) < 1e-5 * np.max(np.abs(from_ends))


def test_states_that_hardly_move_do_not_make_the_linear_part_run_away() -> None:
    strange = fly_stranger(SEED)
    groups = dataset(records(strange), strange.plan.vehicle.band_hz).stacks
    values = {**strange.plan.vehicle.table, **WANDERING, "L_w": -0.9, "M_w": 4.46, "tau_w": 0.05}
    structure = compose("tpp", ["rotor_speed", "slipstream_wing"], ("omega",), {"Omega_0": values["omega"]})
    vector = structure.vector({name: values[name] for name in structure.names})
    for group in groups:
        assert np.all(np.isfinite(respond(structure, vector, group, False).Y))


def test_derivatives_are_the_same_however_many_go_side_by_side_and_are_worked_out_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    flown = [Record(f"#{i}", run) for i, run in enumerate(fly(None, {}, seed=4, duration_s=8.0))]
    structure = compose("tpp", ["quadratic_damping"])
    values = structure.vector({**TABLE_4, "L_pp": -2.0, "M_qq": -3.0, "exponent": 2.0})
    made: list[int] = []
    plain = relaxation._settle_beside

    def counted(run: Any, tangent: Any, batch: Any, U: Any) -> ComplexArray:
        made.append(len(batch) - 1)
        return plain(run, tangent, batch, U)

    monkeypatch.setattr(relaxation, "_settle_beside", counted)
    found = []
    for together in (1, 10**9):
        monkeypatch.setattr(relaxation, "TOGETHER", together)
        (group,) = dataset(flown, (0.3, 10.0)).stacks
        found.append([respond(structure, values, group, True).slopes for _ in range(2)])
        assert sum(made) == len(structure.names) * len(group.spectra)
        assert max(made) == (relaxation.FEWEST_TOGETHER if together == 1 else len(structure.names))
        np.testing.assert_array_equal(found[-1][0], found[-1][1])
        made.clear()
    size = np.linalg.norm(found[0][0], axis=(1, 2))
    assert np.all(np.linalg.norm(found[0][0] - found[1][0], axis=(1, 2)) < 0.01 * size)


@pytest.mark.parametrize(
    ("effects", "extra", "channels"),
    [
        (["quadratic_damping"], {"L_pp": -40.0, "M_qq": -30.0}, ()),
        (["rotor_speed"], WANDERING, ("omega",)),
        *thorough(
            [
                (["quadratic_damping", "gyro_filter"], {"exponent": 2.6, "corner": 60.0}, ()),
                (["rotor_speed", "structural_mode"], WANDERING, ("omega",)),
                (["servo_saturation", "quadratic_damping"], {"limit": 0.4, "exponent": 1.5}, ()),
            ]
        ),
    ],
)
def test_derivatives_are_those_of_responses_that_settle_by_themselves(
    monkeypatch: pytest.MonkeyPatch, effects: list[str], extra: dict[str, float], channels: tuple[str, ...]
) -> None:
    """Central differences of responses, each relaxed until next to nothing changes."""
    runs = fly(None, {}, seed=4, duration_s=4.0)
    turning = 172.0 * (1 + 0.1 * np.sin(np.arange(runs[0]["p"].size) * 0.004))
    flown = [Record(f"#{i}", {**run, "omega": turning}) for i, run in enumerate(runs)]
    (group,) = dataset(flown, (0.3, 10.0)).stacks
    structure = compose("tpp", effects, channels, {"Omega_0": 172.0} if channels else {})
    known = {one.name: one.typical for one in structure.parameters}
    values = structure.vector({**known, **TABLE_4, **extra})
    slopes = respond(structure, values, group, True, group.U).slopes
    monkeypatch.setattr(relaxation, "RELAXED", 1e-9)
    monkeypatch.setattr(relaxation, "RELAXATIONS", 200)
    for name, found in zip(structure.names, slopes, strict=True):
        step = 1e-3 * max(abs(values[structure.names.index(name)]), 1e-2)
        at = [values + sign * step * (np.array(structure.names) == name) for sign in (1, -1)]
        up, down = (respond(structure, one, group, False, group.U).Y for one in at)
        expected = (up - down) / (2 * step)
        assert np.linalg.norm(found - expected) <= 0.005 * np.linalg.norm(expected), name
