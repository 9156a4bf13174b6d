"""A helicopter that flew under ArduPilot's rate loops: what was fitted to its flights, and what it flew with."""

from __future__ import annotations

from sysid.model.compose import compose
from sysid.model.structure import Model
from sysid.rate_loop.settings import AxisLoop

HELI = {
    "L_b": 3592.566711812119, "M_a": 619.8094377415392, "tau_f": 0.0680338161132252, "A_b": -1.3337047594933167,
    "B_a": 1.3001938735972434, "A_lat": 0.07264540581484866, "A_lon": 0.2697942519965967,
    "B_lat": 0.2446091953116641, "B_lon": -0.08555143801791774, "T_d": 0.050749921110463884,
}  # fmt: skip
"""Fitted to a helicopter's flights."""
ROLL = AxisLoop(p=0.06, i=0.105, d=1e-4, ff=0.21, target_hz=20, error_hz=20, angle_p=4.0)
PITCH = AxisLoop(p=0.024, i=0.095, d=2e-3, ff=0.19, target_hz=20, error_hz=20, angle_p=6.0)
"""What it flew with."""


def heli(**values: float) -> Model:
    structure = compose("tpp", ("transport_delay",))
    return Model(structure, structure.vector({**HELI, **values}))
