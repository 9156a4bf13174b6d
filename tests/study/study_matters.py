"""Whether what is left is within what a complete diagnosis says it could do, on vehicles with something small hidden.

Each has one linear effect, smaller than what a diagnosis would find in 80 % of flights of 15 s; one that is named all
the same counts for nothing here. Gains are designed on the fit without it and flown on the vehicle that has it: how far
its margins are from those that the design promised must lie within the bound said, the fit's own errors (two standard
deviations, from draws of its covariance) beside it.
"""

from __future__ import annotations

import numpy as np
import planted
from planted_fits import records
from study_model_error import FIXED, LARGEST

from sysid.control.regulator import lqr
from sysid.control.stability import closed_loop
from sysid.diagnose.could_hide import could_hide
from sysid.diagnose.diagnose import diagnose
from sysid.diagnose.evidence import instrumental_step
from sysid.diagnose.loop_change import of_margins
from sysid.diagnose.matters import remainder
from sysid.fit.identify import on_runs
from sysid.model.compose import compose
from sysid.model.structure import Model

FLIGHTS = 10
FIRST_SEED = 8200
SECONDS = 8.0
PARTS = (0.2, 0.8)
"""Of those sizes."""
DRAWS = 12
LEAST = 6
"""Complete ones, without which the study shows nothing."""
WITHIN = 0.93
LINEAR = [name for name in LARGEST if name not in ("quadratic_damping", "servo_backlash", "servo_deadband")]


def study_matters() -> None:
    rng, inside, alone, complete = np.random.default_rng(FIRST_SEED), [], [], 0
    for number in range(FLIGHTS):
        effect, part = LINEAR[number % len(LINEAR)], rng.uniform(*PARTS)
        size = {name: value if name in FIXED else part * value for name, value in LARGEST[effect].items()}
        steps = 8 if "lag" in effect else planted.STEPS
        runs = records(planted.fly(effect, size, seed=FIRST_SEED + number, duration_s=SECONDS, steps=steps))
        answer = diagnose(on_runs("tpp", (), runs, runs), runs, chains=False)
        if answer.verdict != "complete":
            print(f"  {effect}: {answer.verdict}")
            continue
        parent, white = answer.parent, answer.whitening
        left = remainder(answer, could_hide(parent, instrumental_step(parent, white), white, answer.division))
        assert left.margins is not None
        complete += 1
        model = parent.model
        gains = lqr(model)
        flown = compose("tpp", [effect])
        there = closed_loop(gains, Model(flown, flown.vector({**planted.TABLE_4, **size}))).margins
        assert there is not None
        true = of_margins(gains.margins, there)
        drawn = rng.multivariate_normal(model.values, parent.estimate.covariance, DRAWS)
        loops = [closed_loop(gains, Model(model.structure, x)).margins for x in drawn]
        chance = [of_margins(gains.margins, at) for at in loops if at is not None]
        spread = 2 * np.sqrt(np.mean([[one.gain_db**2, one.phase_deg**2] for one in chance], axis=0))
        said = left.margins
        bounds = (said.gain_db, said.phase_deg)
        for value, bound, more in zip((true.gain_db, true.phase_deg), bounds, spread, strict=True):
            inside.append(value <= bound + more)
            alone.append(value <= bound)
        print(
            f"  {effect:20} {true.gain_db:.2f} dB {true.phase_deg:.2f} deg; "
            f"said {said.gain_db:.2f} {said.phase_deg:.2f}, by chance {spread[0]:.2f} {spread[1]:.2f}; "
            f"within {left.within_points:.2f} points"
        )
    print(
        f"{complete} of {FLIGHTS} complete; margins within what is said and chance: {np.mean(inside):.1%}; "
        f"within what is said alone {np.mean(alone):.1%}"
    )
    assert complete >= LEAST
    assert np.mean(inside) >= WITHIN
