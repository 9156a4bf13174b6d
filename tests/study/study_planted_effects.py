"""Every effect of the catalogue, planted by an independent integrator and fitted: its parameters come back.

Closed loop, coloured gusts, sensor noise. The share within 3 standard errors is counted over the effects' own
parameters; spread and mean say whether what is outside is scatter or bias.
"""

from __future__ import annotations

import math
import time

import numpy as np
from planted import FORWARD, PLANTED, TABLE_4, TABLE_5, fly_many
from planted_fits import effects_with, fitted, in_standard_errors, planted_values, records

from sysid.data.preprocess import spectra
from sysid.data.stacks import stack
from sysid.errors import SysidError
from sysid.fit.identify import on_runs
from sysid.model import predict
from sysid.model.effect import at_null, find

LINEAR_FLIGHTS = 60
NONLINEAR_FLIGHTS = 20
"""Their fits take longest."""
AT_ONCE = 20
WITHIN = 3.0
WANTED = 0.99
ROUTE = {True: 1e-8, False: 1e-4}
"""How far linear and nonlinear compositions agree with the bare base, of the largest value, being computed in another
way: by matrices, and by relaxation, which leaves out what sampling folds back from above its band."""
LAGS = {"servo_lag", "servo_second_order", "gyro_lag"}
"""Without a time constant they have no state equation; the contract test goes near."""


def study_planted_effects() -> None:
    print(
        f"\n{'effect':22} {'flights':>7} {'s/fit':>6} {'within 3':>9}   z of each parameter: mean ± spread "
        f"(of {LINEAR_FLIGHTS}, ± {LINEAR_FLIGHTS**-0.5:.2f} and {(2 * LINEAR_FLIGHTS) ** -0.5:.2f} by sampling)"
    )
    inside = total = 0
    short, refused = [], []
    for number, effect in enumerate(PLANTED):
        truth = planted_values(effect)
        flights = LINEAR_FLIGHTS if find(effect).linear else NONLINEAR_FLIGHTS
        z: list[list[float]] = []
        names = [name for name in PLANTED[effect] if name in truth]
        spent = 0.0
        begin_at = 1000 * (number + 1)  # weather of its own, so that chance does not repeat from effect to effect
        for first in range(begin_at, begin_at + flights, AT_ONCE):
            seeds = range(first, min(first + AT_ONCE, begin_at + flights))
            flown = fly_many(effect, PLANTED[effect], seeds=seeds, forward=effect in FORWARD)
            for seed, flight in zip(seeds, flown, strict=True):
                begin = time.perf_counter()
                try:
                    off = in_standard_errors(fitted(effect, flight), truth)
                except SysidError as error:
                    refused.append(f"  {effect}, flight {seed}: {error}")
                    off = dict.fromkeys(names, math.inf)
                spent += time.perf_counter() - begin
                z.append([off[name] for name in names])
        of_all = np.array(z)
        good = np.abs(of_all) < WITHIN
        inside, total = inside + int(good.sum()), total + good.size
        usable = of_all[np.all(np.isfinite(of_all), axis=1)]
        listed = ", ".join(
            f"{name} {one.mean():+.2f} ± {one.std(ddof=1):.2f}" for name, one in zip(names, usable.T, strict=True)
        )
        print(f"{effect:22} {flights:7d} {spent / flights:6.2f} {good.mean():9.1%}   {listed}", flush=True)
        if good.mean() < WANTED:
            short.append(f"{effect} {good.mean():.1%}")
    print(f"all: {inside} of {total} parameters, {inside / total:.2%}, within {WITHIN:g} standard errors")
    print(f"by themselves below {WANTED:.0%}: {', '.join(short) or 'none'}")
    if refused:
        print("\n".join(["not fitted:", *refused]))
    assert inside >= WANTED * total


def study_nulls_on_a_flight() -> None:
    """At its null an effect leaves the base's prediction of a whole flight, as far as two ways to compute it agree."""
    print(f"\n{'effect':22} {'difference from the base at the null':>37}")
    flights = {}
    for forward in (False, True):
        (flight,) = fly_many(None, {}, seeds=[5], forward=forward)
        # yaw turns the disc by itself: it has no null of its own
        flights[forward] = records([{**run, "r": 0 * run["r"]} for run in flight])
    for name in PLANTED:
        effect, flight = find(name), flights[name in FORWARD]
        if not effect.has_null or name in LAGS or name == "disc_incidence":  # which needs a vane
            continue
        truth = {**TABLE_5, "A_alpha": 0.0} if name in FORWARD else dict(TABLE_4)
        composed = on_runs("tpp", effects_with(name), flight, flight)
        without = on_runs("tpp", [one for one in effects_with(name) if one != name], flight, flight)
        own = next(one for one in composed.composed if one.id == name)
        stacks = stack(spectra(flight, composed.inputs, composed.outputs)[0])
        new = predict.respond(composed, composed.vector({**truth, **at_null(own)}), stacks[0], False).Y
        old = predict.respond(without, without.vector(truth), stacks[0], False).Y
        off = float(np.max(np.abs(new - old)) / np.max(np.abs(old)))
        print(f"{name:22} {off:37.1e}")
        assert off <= max(effect.null_tolerance, ROUTE[effect.linear]), name
