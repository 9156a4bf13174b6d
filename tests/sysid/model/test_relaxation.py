"""Where a response that is not linear, or wanders with time, must settle."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from planted import TABLE_4, fly
from strangers.asking import records
from strangers.flights import fly as fly_stranger

from sysid.data.dataset import dataset
from sysid.data.preprocess import ComplexArray
from sysid.data.record import Record
from sysid.data.stacks import Stack
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


def test_states_that_hardly_move_do_not_make_the_linear_part_run_away() -> None:
    strange = fly_stranger(SEED)
    groups = dataset(records(strange), strange.plan.vehicle.band_hz).stacks
    values = {**strange.plan.vehicle.table, **WANDERING, "L_w": -0.9, "M_w": 4.46, "tau_w": 0.05}
    structure = compose("tpp", ["rotor_speed", "slipstream_wing"], ("omega",), {"Omega_0": values["omega"]})
    vector = structure.vector({name: values[name] for name in structure.names})
    for group in groups:
        assert np.all(np.isfinite(respond(structure, vector, group, False).Y))
