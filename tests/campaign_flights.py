"""Outcomes of flights that were never flown: numbers around a truth, with what is planted in them."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime, timedelta

import numpy as np

from gcs.campaign.when import When
from gcs.campaign.work import AtBound, Number, Numbers, Outcome, Settings

TRUTH: Mapping[str, tuple[float, float, str]] = {
    "L_b": (147.5, 2.0, "1/s^2"),
    "M_a": (713.4, 8.0, "1/s^2"),
    "tau_f": (0.091, 0.002, "s"),
    "T_d": (0.012, 0.003, "s"),
    "tau_s": (0.018, 0.003, "s"),
}
"""Value, standard error, unit; the last two are close: what one of them has too much the other has too little."""
BEGIN = datetime(2026, 1, 3, 10, tzinfo=UTC)
STEP_DAY = 121
"""4 May 2026."""


def outcomes(
    count: int = 40,
    *,
    seed: int = 0,
    vehicle: str = "A",
    step: Mapping[str, float] | None = None,
    drift: Mapping[str, float] | None = None,
    per_rotor_speed: Mapping[str, float] | None = None,
    correlation: float = -0.97,
    spread: float = 0.5,
    days: int = 365,
    zero: str | None = None,
) -> tuple[Outcome, ...]:
    """A year's flights; `spread` between days, in standard errors; one parameter that is 0, and
    cannot be below."""
    chance, names = np.random.default_rng(seed), list(TRUTH)
    alike = np.eye(len(names))
    alike[3, 4] = alike[4, 3] = correlation
    made = []
    for number, day in enumerate(np.sort(chance.integers(0, days, count))):
        when, omega = BEGIN + timedelta(days=int(day)), 172.0 + chance.normal(0, 3)
        error = np.array([one[1] for one in TRUTH.values()]) * chance.uniform(0.6, 1.7)
        covariance = alike * np.outer(error, error)
        value = np.array([one[0] for one in TRUTH.values()])
        if zero is not None:
            value[names.index(zero)] = 0.0
        for name, size in (step or {}).items():
            value[names.index(name)] += size * (day >= STEP_DAY)
        for name, size in (drift or {}).items():
            value[names.index(name)] += size * day / 365.25
        for name, size in (per_rotor_speed or {}).items():
            value[names.index(name)] += size * (omega - 172.0)
        value += chance.multivariate_normal(np.zeros(len(names)), covariance + spread**2 * np.diag(error**2))
        at = [place for place, name in enumerate(names) if name != zero or value[place] > 0]
        made.append(
            Outcome(
                key=f"{seed:04x}{number:060x}",
                path=f"logs/{vehicle}/{when:%Y-%m-%d}-{number:03d}.BIN",
                sha256="0" * 64,
                version="0",
                settings=Settings(),
                when=When(utc=when.isoformat(timespec="seconds"), told_by="satellites"),
                conditions={"omega": omega},
                seen=f"{vehicle} {number}",
                fit=Numbers(
                    structure="TPP + transport_delay + servo_lag",
                    base="tpp",
                    effects=("transport_delay", "servo_lag"),
                    parameters={
                        name: Number(value=float(v), unit=TRUTH[name][2], standard_error=float(e), model_error=0.0)
                        for name, v, e in ((names[i], value[i], error[i]) for i in at)
                    },
                    covariance=tuple(tuple(float(x) for x in row) for row in covariance[np.ix_(at, at)]),
                    at_bound={names[i]: AtBound(value=0.0, unit="s") for i in range(len(names)) if i not in at},
                    nrmse_percent={"p": 93.0 + chance.normal(), "q": 91.0 + chance.normal()},
                    validation_nrmse_percent=None,
                    band_hz=(0.5, 10.0),
                    warnings=(),
                    model={},
                ),
            )
        )
    return tuple(made)
