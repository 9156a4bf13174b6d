"""A servo with a dead band stands anywhere when a run begins: the run itself shows where."""

from __future__ import annotations

import numpy as np
import pytest
from planted import fly_many
from planted_fits import records

from sysid.data.dataset import dataset
from sysid.data.record import Record
from sysid.diagnose.initial_states import begun, validation_error
from sysid.fit.estimate import estimate
from sysid.fit.output_error import output_error
from sysid.model.compose import compose

WIDTH = 0.04
"""As wide as a third of the commands: where it stands is remembered for long."""
CUT_S = 3.3


def test_where_a_servo_stood_is_found() -> None:
    flight = records(fly_many("servo_deadband", {"width": WIDTH}, seeds=[81], duration_s=20.0)[0])
    on = dataset(flight, (0.0, 15.0))
    structure = compose("tpp", ["servo_deadband"], on.available)
    model = estimate(
        structure, on.viewed(structure.inputs), estimate(compose("tpp"), on.viewed(compose("tpp").inputs)).model
    ).model
    assert model["width"] == pytest.approx(WIDTH, rel=0.01)
    later = [_cut(one) for one in flight]
    other = dataset(later, (0.0, 15.0), on)
    plain, found = output_error(model, other.stacks), validation_error(model, other)
    assert np.all(found.residual_power < 0.5 * plain.residual_power)
    assert np.min(found.nrmse_percent) > np.min(output_error(model, on.stacks).nrmse_percent) - 5


def test_nothing_changes_where_nothing_rests() -> None:
    flight = records(fly_many("servo_lag", {"tau_s": 0.03}, seeds=[82], duration_s=10.0)[0])
    on = dataset(flight, (0.0, 15.0))
    structure = compose("tpp")
    model = estimate(structure, on.viewed(structure.inputs)).model
    assert all(a is b for a, b in zip(begun(model, on.spectra), on.spectra, strict=True))
    assert np.array_equal(validation_error(model, on).residual_power, output_error(model, on.stacks).residual_power)


def _cut(one: Record) -> Record:
    """Without its first seconds: it begins in the middle of a motion."""
    keep = one.channels["t"] >= one.channels["t"][0] + CUT_S
    return Record(one.id, {name: values[keep] for name, values in one.channels.items()})
