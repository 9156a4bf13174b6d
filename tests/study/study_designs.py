"""600 random vehicles, late by a delay, servos or gyro filters of 0 to 60 ms in all: gains are written if and only if
they hold, as a simulation in time tells that shares no code with the decision.

And twenty of them flown and fitted: the gains that are designed on the fit hold the fit and the vehicle.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice

import numpy as np
from loops_in_time import LATE_BY, Late, flown, gains_of, growth, late_of, model_of, random_vehicles
from planted import DT

from sysid.control.regulator import Gains, NotHeldError, design
from sysid.errors import FitError
from sysid.fit.identify import identify
from sysid.fit.result import Fit
from sysid.model.paper import TPP

VEHICLES = 600
FITTED = 20
FITTED_COST = 2.0
SECONDS = 20


def _designed(vehicle: Late) -> tuple[Gains | None, Gains | None]:
    """As asked for, or those offered in their place."""
    try:
        return design(model_of(vehicle), vehicle.input_cost), None
    except NotHeldError as error:
        return None, error.instead


def study_600_designs_on_late_vehicles() -> None:
    vehicles = list(islice(random_vehicles(0), VEHICLES))
    designs = [_designed(one) for one in vehicles]
    grows = growth([(one, *gains_of(one)) for one in vehicles], SECONDS)
    written = np.array([gains is not None for gains, _ in designs])
    offered = [(one, instead) for one, (_, instead) in zip(vehicles, designs, strict=True) if instead is not None]
    offered_grow = growth([(one, instead.K, instead.observer_gain) for one, instead in offered], SECONDS)
    for one, (gains, _) in zip(vehicles, designs, strict=True):
        if gains is not None:
            np.testing.assert_allclose(gains.K, gains_of(one)[0], rtol=1e-6, atol=1e-9)
    print(f"\nDesigns on {VEHICLES} random vehicles, 0 to 60 ms late, at input costs of 1 to 50")
    print(f"  {'late by':46} vehicles  written  refused    grows dies out")
    for effects in LATE_BY:
        of = np.array([one.effects == effects for one in vehicles])
        counts = [of, of & written, of & ~written, of & written & (grows >= 0), of & ~written & (grows < 0)]
        print(f"  {' + '.join(effects):46}" + "".join(f"{np.sum(x):9d}" for x in counts))
    print("  (grows: of the written; dies out: of the refused)")
    print(f"  nearest to the edge: growth of {np.min(np.abs(grows)):.3f} 1/s; the refused grow by")
    print(f"    {np.min(grows[~written], initial=np.inf):.3f} 1/s or more, the written die out by")
    print(f"    {-np.max(grows[written], initial=-np.inf):.3f} 1/s or more")
    print(f"  {np.sum(~written)} refused, {len(offered)} of them with gains offered, which all die out by")
    print(f"    {-np.max(offered_grow, initial=-np.inf):.3f} 1/s or more")
    assert not np.any(written & (grows >= 0))
    assert not np.any(~written & (grows < 0))
    assert len(offered) == np.sum(~written)
    assert np.all(offered_grow < 0)


def study_designs_on_fits_of_late_vehicles() -> None:
    fits = list(islice(_fitted(), FITTED))
    held, refused = [], []
    for fit, vehicle in fits:
        try:
            gains = design(fit.model, vehicle.input_cost)
        except NotHeldError:
            refused.append((late_of(fit.model, vehicle.input_cost), vehicle))
        else:
            held.append((late_of(fit.model, vehicle.input_cost), vehicle, gains))
    on_fits = growth([(fit, gains.K, gains.observer_gain) for fit, _, gains in held], SECONDS)
    on_vehicles = growth([(vehicle, gains.K, gains.observer_gain) for _, vehicle, gains in held], SECONDS)
    of_refused = growth([(fit, *gains_of(fit)) for fit, _ in refused], SECONDS)
    print(f"\nDesigns on {FITTED} fits of two chirps each: {len(held)} written, {len(refused)} refused")
    print(f"  written: on the fit all die out by {-np.max(on_fits):.3f} 1/s or more,")
    print(f"    on the vehicle that flew by {-np.max(on_vehicles):.3f} 1/s or more")
    print(f"  refused: the fit's loop grows by {np.min(of_refused):.3f} 1/s or more")
    assert np.all(on_fits < 0)
    assert np.all(on_vehicles < 0)
    assert np.all(of_refused > 0)


def _fitted() -> Iterator[tuple[Fit, Late]]:
    """Without end: vehicles, flown and fitted with what makes them late. What no flight tells is held at its value."""
    for one in random_vehicles(1):
        lag = {**one.lag, **({"T_d": DT * round(one.lag["T_d"] / DT)} if "T_d" in one.lag else {})}
        vehicle = replace(one, lag=lag, input_cost=FITTED_COST)
        known = {"tau_s", "tau_g"} <= set(lag) and {"tau_g": lag["tau_g"]}
        records = [flown(vehicle, axis) for axis in ("roll", "pitch")]
        with contextlib.suppress(FitError):  # servos too fast to be seen
            yield identify(TPP, records, effects=one.effects, fixed=known or None), vehicle
