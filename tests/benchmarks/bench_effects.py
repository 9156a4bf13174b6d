"""What one effect more costs: every entry of the catalogue fitted to the same 64,000 samples, against peers.

`make bench` prints it. A simulation is one `scipy.signal.lsim` of the data; the base is the fit of the bare TPP.
"""

from __future__ import annotations

import tracemalloc

import numpy as np
from planted import FORWARD, TABLE_4, fly
from scipy.signal import lsim
from timing import best_of

from sysid.data.dataset import prepared
from sysid.data.preprocess import DEFAULT_BAND_HZ
from sysid.data.record import Record
from sysid.errors import FitError
from sysid.fit.estimate import estimate
from sysid.fit.identify import identify, on_runs
from sysid.model.compose import compose
from sysid.model.effect import EffectError, catalogue
from sysid.model.paper import TPP
from sysid.model.structure import Model


def runs(forward: bool) -> list[Record]:
    unerring = ("phi", "theta")
    return [
        Record(f"#{i}", {name: values for name, values in run.items() if name not in unerring})
        for i, run in enumerate(
            fly("elevator" if forward else None, {"M_elev": 37.752} if forward else {}, seed=3, forward=forward)
        )
    ]


def bench_every_effect_on_the_base() -> None:
    matrices = tuple(Model(TPP, np.array(list(TABLE_4.values()))).matrices)
    print()
    for forward in (False, True):
        records = runs(forward)
        base_effects = ["angular_damping", "elevator"] if forward else []
        structure = on_runs("tpp", base_effects, records, records)
        found = prepared(records, DEFAULT_BAND_HZ).viewed(structure.inputs)
        base = estimate(structure, found)
        base_s = best_of(3, lambda structure=structure, found=found: estimate(structure, found))
        simulation_s = best_of(
            3,
            lambda records=records: [
                lsim(
                    matrices,
                    np.stack([one.channels["delta_x"], one.channels["delta_y"]], axis=1),
                    one.t - one.t[0],
                    interp=False,
                )
                for one in records
            ],
        )
        samples = sum(one.t.size for one in records)
        name = "forward" if forward else "hover"
        print(f"{name}: {samples} samples, base {1000 * base_s:.0f} ms, simulation {1000 * simulation_s:.0f} ms")
        for effect in catalogue().values():
            if (effect.id in FORWARD) != forward or effect.id in base_effects:
                continue
            try:
                grown = on_runs("tpp", [*base_effects, effect.id], records, records)
                bins = prepared(records, DEFAULT_BAND_HZ).viewed(grown.inputs)
                spent = best_of(1, lambda grown=grown, bins=bins, base=base: estimate(grown, bins, base.model))
            except (EffectError, FitError) as error:
                print(f"  {effect.id:24} not on these runs: {str(error)[:70]}")
                continue
            kind = "linear" if effect.linear else "nonlinear"
            ratios = f"{spent / base_s:6.1f} base   {spent / simulation_s:6.2f} simulations"
            print(f"  {effect.id:24} {kind:9} {1000 * spent:8.0f} ms   {ratios}")


def bench_memory() -> None:
    records = runs(False)
    data = sum(
        values.nbytes
        for one in records
        for name, values in one.channels.items()
        if name in ("p", "q", "delta_x", "delta_y")
    )
    print()
    for effects in ([], ["servo_lag"], ["quadratic_damping"], ["rotor_speed"], ["servo_deadband"]):
        tracemalloc.start()
        identify(compose("tpp"), records, effects=effects)
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        print(
            f"memory, tpp {' '.join(effects):18} {peak / 1e6:6.1f} MB, {peak / data:4.1f} times the samples it works on"
        )
