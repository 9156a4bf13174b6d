"""What weights by the residual's spectrum are worth: errors and standard errors beside those of constant weights.

Short closed-loop flights in usual and doubled gusts, with the excitation logged and without. So short, either weights
have standard errors a tenth too small; with 30 s they are right.
"""

from __future__ import annotations

from typing import get_args

import numpy as np
import pytest
from planted import TABLE_4, fly_many
from planted_fits import in_standard_errors, records

from sysid.fit.estimate import Weights
from sysid.fit.identify import identify
from sysid.model.paper import TPP

FLIGHTS = 40
FIRST_SEED = 3000
SECONDS = 12.0
EXCITATIONS = ("excitation_x", "excitation_y", "excitation_e")
LEAST_RATIO = 1.7
SPREAD = (0.85, 1.15)


@pytest.mark.parametrize("gusts", [1.0, 2.0])
def study_weights(gusts: float) -> None:
    flights = fly_many(None, {}, seeds=range(FIRST_SEED, FIRST_SEED + FLIGHTS), duration_s=SECONDS, gusts=gusts)
    truth = np.array([TABLE_4[name] for name in TPP.names])
    print(f"\nTPP, {FLIGHTS} flights of four {SECONDS:g}-s chirps, gusts x{gusts:g}")
    for logged in (True, False):
        errors, z = {}, {}
        for kind in get_args(Weights):
            fits = [identify(TPP, records(one, *(() if logged else EXCITATIONS)), weights=kind) for one in flights]
            errors[kind] = np.sqrt(np.mean([(fit.model.values - truth) ** 2 for fit in fits], axis=0))
            each = np.array([list(in_standard_errors(fit, TABLE_4).values()) for fit in fits])
            z[kind] = float(np.sqrt(np.mean(each**2)))
        ratio = errors["constant"] / errors["residual spectrum"]
        mean = float(np.exp(np.mean(np.log(ratio))))
        print(
            f"  excitation {'logged' if logged else 'not logged'}: errors of constant weights over these {mean:.2f} "
            f"({ratio.min():.2f} to {ratio.max():.2f}); z rms {z['constant']:.2f} -> {z['residual spectrum']:.2f}"
        )
        assert mean > LEAST_RATIO
        assert SPREAD[0] < z["residual spectrum"] < SPREAD[1]
