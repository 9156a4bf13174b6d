"""How much of a rate doublet goes to the other axis, before and after: the paper's prefilter, and a dynamic one.

Three kinds of vehicle, each answering in time by equations that share no code with the design. Table 4's with other
numbers, late by 0 to 60 ms, designed on what they are; the same, flown and fitted, designed on the fit; and strangers'
three sizes with servos of up to 30 ms, designed on what they are. Gains are those of the first input cost, from the
paper's upwards, that leaves the asked margins.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import islice

import numpy as np
from loops_in_time import LATE_BY, Late, Law, doublet, flown, model_of, random_vehicles
from planted import DT
from strangers.vehicles import drawn

from sysid.control.decoupling import decoupled
from sysid.control.regulator import COSTS, INPUT_COST, Gains, lqr
from sysid.errors import SysidError
from sysid.fit.identify import identify
from sysid.model.paper import TPP
from sysid.model.structure import Model

KNOWN, FITTED, STRANGERS = 60, 24, 40
SEED = 170


def _answers(gains: Gains, vehicle: Late) -> list[float]:
    """By time: the larger overshoot and coupling, and both rises in ms (NaN where never)."""
    law = Law(gains.prefilter)
    if gains.dynamic is not None:
        law = Law(gains.prefilter, gains.dynamic.F, gains.dynamic.frequency, float(gains.dynamic.damping[0]))
    rates = [doublet(vehicle, gains.K, gains.observer_gain, law, axis) for axis in (0, 1)]
    over = max(max(0.0, float(np.max(np.abs(one[:, axis]))) - 1) for axis, one in enumerate(rates))
    other = max(float(np.max(np.abs(one[:, 1 - axis]))) for axis, one in enumerate(rates))
    rises = [np.flatnonzero(one[:, axis] >= 0.9) for axis, one in enumerate(rates)]
    return [over, other, *(0.5 * float(at[0]) if at.size else np.nan for at in rises)]


def _gains(model: Model) -> Gains | None:
    for cost in (INPUT_COST, *(cost for cost in COSTS if cost > INPUT_COST)):
        gains = lqr(model, cost)
        if gains.loop.margins is not None and gains.loop.margins.sensible:
            return gains
    return None


def _strangers() -> Iterator[Late]:
    """A stranger's rotor and body, and a servo of 5 to 30 ms of the paper's vehicle's."""
    rng = np.random.default_rng(SEED)
    while True:
        table = drawn(rng).table
        values = {name: float(table[name]) for name in TPP.names}
        yield Late(values, {"tau_s": float(rng.uniform(0.005, 0.030)) * values["tau_f"] / 0.091}, ("servo_lag",))


def _fits() -> Iterator[tuple[Model, Late]]:
    for vehicle in random_vehicles(SEED + 1):
        if "servo_second_order" in vehicle.effects or len(vehicle.effects) > 1:
            continue
        whole = round(vehicle.lag.get("T_d", 0.0) / DT)
        lag = vehicle.lag | ({"T_d": max(1, whole) * DT} if "T_d" in vehicle.lag else {})
        vehicle = Late(vehicle.parameters, lag, vehicle.effects)
        try:
            fit = identify(TPP, [flown(vehicle, axis) for axis in ("roll", "pitch")], effects=vehicle.effects)
        except SysidError:
            continue
        yield fit.model, vehicle


def _compared(pairs: Iterator[tuple[Model, Late]], count: int) -> tuple[np.ndarray, np.ndarray]:
    before, after = [], []
    for model, vehicle in pairs:
        gains = _gains(model) if model.stable else None
        if gains is None:
            continue
        found = decoupled(gains, [model])
        before.append(_answers(gains, vehicle))
        after.append(_answers(found, vehicle))
        if len(after) == count:
            break
    return np.array(before), np.array(after)


def _told(name: str, before: np.ndarray, after: np.ndarray) -> None:
    print(f"\n{name}: {len(after)} vehicles, margins the same to the last digit")
    for what, one in (("steady", before), ("dynamic", after)):
        each = [
            f"{100 * np.median(one[:, k]):.0f} % (90 % below {100 * np.quantile(one[:, k], 0.9):.0f})" for k in (0, 1)
        ]
        rises = [f"{np.nanmedian(one[:, k]):.0f} ms" for k in (2, 3)]
        within = np.mean((one[:, 0] <= 0.25) & (one[:, 1] <= 0.25))
        print(
            f"  {what:8} overshoot {each[0]}, other axis {each[1]}, rise {' / '.join(rises)}, within 25 %: {within:.0%}"
        )


def study_how_much_goes_to_the_other_axis() -> None:
    kinds: Sequence[tuple[str, Iterator[tuple[Model, Late]], int]] = (
        ("late by 0 to 60 ms, known", ((model_of(one), one) for one in random_vehicles(SEED)), KNOWN),
        ("late, flown and fitted", _fits(), FITTED),
        ("strangers of three sizes", ((model_of(one), one) for one in _strangers()), STRANGERS),
    )
    for name, pairs, count in kinds:
        before, after = _compared(islice(pairs, 4 * count), count)
        _told(name, before, after)
        assert len(after) >= 20, name
        assert np.all(after[:, 1] < np.maximum(0.8 * before[:, 1], 0.25)), name
        assert np.median(after[:, 1]) < 0.2
        assert len(LATE_BY) <= len(after)
