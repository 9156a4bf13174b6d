"""What entries of the catalogue are drawn to do, against flights that an independent integrator makes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import planted
import pytest

from sysid.model.effect import catalogue, find
from sysid.model.signature import DT, doublets, signature_of

INTEGRATED = (
    "dynamic_inflow", "stabiliser_bar", "lead_lag", "slipstream_wing", "gyro_filter", "hub_gyroscopics",
    "quadratic_damping", "servo_backlash", "servo_rate_limit", "servo_acceleration_limit", "transport_delay",
    "swashplate_phase",
)  # fmt: skip


@pytest.mark.parametrize("name", INTEGRATED)
def test_the_answer_to_doublets_is_an_independent_integrator_s(name: str) -> None:
    found = signature_of(find(name))
    sizes = {one.name: one.typical for one in find(name).parameters}
    _, wave = doublets()
    finer = round(DT / planted.DT)
    commands = np.zeros((finer * wave.size, 3))
    commands[:, ("delta_x", "delta_y").index(found.command)] = np.repeat(wave, finer)
    flown = planted.respond(name, sizes, commands)[found.output][::finer]
    change = np.max(np.abs(found.with_effect - found.without))
    # play and limits see a sample, and the trim that `planted` flies at, a little otherwise
    assert found.with_effect == pytest.approx(flown, abs=0.1 * change if find(name).samples else 0.02 * change)


@pytest.mark.parametrize("name", catalogue())
def test_every_entry_has_one(name: str) -> None:
    found = signature_of(find(name))
    assert np.all(np.isfinite(found.with_effect))
    change = np.max(np.abs(found.with_effect - found.without))
    assert change > 0.01 * np.max(np.abs(found.with_effect))
    if found.decibels is not None and found.degrees is not None:
        assert max(np.max(np.abs(found.decibels)), np.max(np.abs(found.degrees)) / 10) > 0.5


def test_at_the_null_nothing_changes() -> None:
    effect = find("hub_gyroscopics")
    nothing = replace(effect, parameters=tuple(replace(one, typical=0.0) for one in effect.parameters))
    found = signature_of(nothing)
    assert found.decibels == pytest.approx(0, abs=1e-9)
    assert found.with_effect == pytest.approx(found.without, abs=1e-12)


def test_what_is_read_is_held_and_what_is_needed_is_beside() -> None:
    governor, scaling = signature_of(find("governor")), signature_of(find("airspeed_scaling"))
    assert governor.held == {"delta_c": 0.3}
    assert governor.command in ("delta_x", "delta_y")
    assert scaling.beside == ("angular_damping",)
    assert signature_of(find("elevator")).command == "delta_e"
