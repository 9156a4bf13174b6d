"""K over input cost with its margins: what a cheaper input buys, and what it costs on every model that is left open."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.control.bounds import margins_json
from sysid.control.judgement import Judgement, Limits, Role, judge
from sysid.control.regulator import INPUT_COST, Gains, lqr
from sysid.control.stability import Margins
from sysid.model.structure import Model

OVER = (1.0, 2.0, 3.0, INPUT_COST, 8.0, 10.0, 15.0, 20.0, 30.0, 50.0, 100.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class AtCost:
    """Gains of one input cost."""

    gains: Gains
    judgement: Judgement

    @property
    def least(self) -> Margins | None:
        return least_margins(self.judgement)

    @property
    def rate_gain(self) -> float:
        """Largest of K, full command per rad/s;"""
        return float(np.max(np.abs(self.gains.K[:, :2])))

    @property
    def flapping_gain(self) -> float:
        """and per rad."""
        return float(np.max(np.abs(self.gains.K[:, 2:])))

    def to_json(self) -> dict[str, Any]:
        return {
            "input_cost": self.gains.input_cost,
            "K": self.gains.K.tolist(),
            "verdict": self.judgement.verdict,
            "margins": None if self.least is None else margins_json(self.least),
            "overshoot": self.judgement.models[0].overshoot,
            "coupling": self.judgement.models[0].coupling,
        }


def least_margins(judgement: Judgement) -> Margins | None:
    """The smallest of each margin on any model; None where one is not held."""
    each = [one.loop.margins for one in judgement.models]
    held = [(one.gain_db, one.phase_deg, one.delay_s) for one in each if one is not None]
    return Margins(*map(float, np.min(held, axis=0))) if len(held) == len(each) else None


def over_costs(
    models: Sequence[tuple[Role, Model]],
    limits: Limits | None = None,
    asked: float = INPUT_COST,
    design: Callable[[float], Gains] | None = None,
) -> tuple[AtCost, ...]:
    """Gains designed at each cost, the asked one among them, and judged on these models; held or not.

    `design` makes them of a cost, else the paper's on the first model. Raises DesignError where none can be designed.
    """
    make = design or (lambda cost: lqr(models[0][1], cost))
    each = (make(cost) for cost in sorted({*OVER, asked}))
    return tuple(AtCost(gains=gains, judgement=judge(gains, models, limits)) for gains in each)
