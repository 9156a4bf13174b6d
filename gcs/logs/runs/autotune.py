"""The stretches in which PX4's autotune excited an axis, and what it identified there.

By its message autotune_attitude_control_status. PX4 adds a train of steps to the rate's setpoint (rate_sp), axis by
axis, and identifies rate per torque setpoint, which is a second opinion. The numbers of its states have changed
(STATE_ROLL is 2 in 1.13 and 3 since amplitudes are looked for), so the axis is read from rate_sp, which all versions
have; in a state that excites two axes gains are tried out.
Fixed wings, and VTOLs in forward flight, tell the same topic of their own autotune: it identifies rate per command
scaled with airspeed, so its model is of other commands than those that are logged, and no second opinion.
Source: msg/AutotuneAttitudeControlStatus.msg and src/modules/mc_autotune_attitude_control of PX4-Autopilot.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from gcs.logs.formats.tables import Log
from gcs.logs.runs.span import Span
from sysid.data.onboard_model import OnboardModel

TOPIC = "autotune_attitude_control_status"
AXES = (("roll", "p", "delta_x"), ("pitch", "q", "delta_y"), ("yaw", "r", "delta_r"))
SHORTEST_S = 3.0
"""It stays with an axis for 5 s at least; what is shorter was broken off."""
ACTIVE = 0.5
"""Share of the samples of a state in which the axis's rate_sp is not zero."""
COEFFICIENTS = 5
TOLD_BY = "PX4's autotune"
FLOWN_AS = "vehicle_status.vehicle_type"
FIXED_WING = 2


def find(log: Log) -> list[Span]:
    """A span for each axis that was excited, in order of time; none where the log has no such topic."""
    keys = [f"{TOPIC}.{name}" for name in ("state", "rate_sp[0]", "rate_sp[1]", "rate_sp[2]")]
    if log.kind != "ulog" or not all(log.has(key) for key in keys):
        return []
    state, *added = (log.series(key) for key in keys)
    edges = [0, *(np.flatnonzero(np.diff(state.values)) + 1).tolist(), state.t.size]
    found = []
    for first, behind in pairwise(edges):
        start, stop = float(state.t[first]), float(state.t[behind - 1])
        active = [np.mean(one.values[first:behind] != 0) > ACTIVE for one in added]
        if stop - start < SHORTEST_S or active.count(True) != 1:
            continue
        axis, output, command = AXES[active.index(True)]
        wings = flown_as(log, start) == FIXED_WING
        model = None if wings else _identified(log, behind - 1, output, command)
        found.append(
            Span(
                start_s=start,
                stop_s=stop,
                first_s=start,
                last_s=stop,
                maneuver="doublet",
                axis=axis,
                excites_command=False,
                notes=(ON_WINGS if wings else _note(model),),
                onboard=model,
            )
        )
    return found


ON_WINGS = (
    f"excited by {TOLD_BY} while it flew as a fixed wing: rates per command go with airspeed there, and what it "
    "identified is of commands scaled with it; fit such runs apart from those of hover"
)


def flown_as(log: Log, at_s: float) -> int | None:
    """PX4's vehicle_type at a time, which a VTOL changes in flight: 1 rotary wing, 2 fixed wing; None where untold."""
    if not log.has(FLOWN_AS):
        return None
    told = log.series(FLOWN_AS)
    value = float(told.values[max(0, int(np.searchsorted(told.t, at_s, "right")) - 1)])
    return int(value) if np.isfinite(value) else None


def _identified(log: Log, at: int, output: str, command: str) -> OnboardModel | None:
    """The model of a sample of the topic; None where it does not hold one."""
    keys = [f"{TOPIC}.coeff[{i}]" for i in range(COEFFICIENTS)]
    if not all(log.has(key) for key in (*keys, f"{TOPIC}.dt_model")):
        return None
    *numbers, dt_s = (float(log.series(key).values[at]) for key in (*keys, f"{TOPIC}.dt_model"))
    if not (np.all(np.isfinite(numbers)) and np.any(numbers[2:]) and 0 < dt_s < 1):
        return None
    return OnboardModel(
        output=output, command=command, a=tuple(numbers[:2]), b=tuple(numbers[2:]), dt_s=dt_s, told_by=TOLD_BY
    )


def _note(model: OnboardModel | None) -> str:
    if model is None:
        return f"excited by {TOLD_BY}; it tells of no model"
    poles = ", ".join(f"{pole.real:.3g}{f' {pole.imag:+.3g}j' if pole.imag else ''}" for pole in model.poles)
    gain = float(np.abs(model.response(np.array([1.0]))[0]))
    return (
        f"excited by {TOLD_BY}, which identified {model.output} per {model.command}: {gain:.3g} at 1 Hz, poles {poles} "
        "1/s; `tippath fit` sets it beside the fit"
    )
