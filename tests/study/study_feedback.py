"""Fits of flights in a loop, by what keeps feedback out: the excitation, logged or rebuilt; the noise, predicted; or
nothing, as before.

    python tests/study/study_feedback.py [FLIGHTS [SECONDS [VERDICTS]]]

Vehicles that are exactly TPP, made without the package, in usual and stronger gusts, under a controller of usual and
doubled gain. Of each way the estimate's errors in standard errors (z): its rms, the largest mean over the flights of a
parameter, and the same mean less that of the flights with their excitation, which share the draw of the noise; and the
errors beside those. VERDICTS of the flights are diagnosed too: nothing is hidden, so each `unexplained` without the
reason `feedback`, and each `missing`, is a false alarm.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

import planted  # noqa: E402
from planted_fits import controlled, records  # noqa: E402

from sysid.data.chirp import Chirp, with_excitation  # noqa: E402
from sysid.data.dataset import prepared  # noqa: E402
from sysid.data.record import Record  # noqa: E402
from sysid.diagnose.diagnose import diagnose  # noqa: E402
from sysid.fit.estimate import Estimate, estimate  # noqa: E402
from sysid.fit.identify import identify  # noqa: E402
from sysid.fit.result import Fit  # noqa: E402
from sysid.model.paper import TPP  # noqa: E402

FIRST_SEED = 9100
EXCITATIONS = ("excitation_x", "excitation_y", "excitation_e")
BAND = (0.0, 15.0)
TRUTH = np.array([planted.TABLE_4[name] for name in TPP.names])
SPREAD = 0.1
"""That z rms may be off one, beside chance;"""
ALONE = 3
"""for which so many parameters of a flight count as independent."""


class Case(NamedTuple):
    name: str
    loop: float
    gusts: float
    size: float = 1.0
    """Of the chirps, of the usual one."""


CASES = (
    Case("usual", 1, 1),
    Case("gusts x2", 1, 2),
    Case("loop x2", 2, 1),
    Case("loop x2, gusts x2", 2, 2),
    Case("loop x2, gusts x4, chirps x0.4", 2, 4, 0.4),
)


def fly(case: Case, flights: int, seconds: float) -> list[list[planted.Run]]:
    with controlled(case.loop, case.size):
        seeds = range(FIRST_SEED, FIRST_SEED + flights)
        return planted.fly_many(None, {}, seeds=seeds, duration_s=seconds, gusts=case.gusts)


def rebuilt(flight: Sequence[planted.Run]) -> list[Record]:
    """Without what was flown beside the chirps, which no settings tell."""
    found = []
    for axis, record in zip(planted.axes(False), records(flight, *EXCITATIONS), strict=True):
        seconds = float(record.t[-1]) - 2 * planted.REST_S
        chirp = Chirp(axis=axis, law="tischler", f_start_hz=0.5, f_stop_hz=10.0, duration_s=round(seconds, 1))
        again = with_excitation(record, chirp, planted.REST_S + 0.1, 0.3, "settings")
        assert again is not None
        found.append(again)
    return found


def as_before(flight: Sequence[planted.Run]) -> Estimate:
    return estimate(TPP, prepared(records(flight, *EXCITATIONS), BAND).viewed(TPP.inputs, TPP.outputs))


WAYS: dict[str, Callable[[Sequence[planted.Run]], Fit | Estimate]] = {
    "logged": lambda flight: identify(TPP, records(flight)),
    "rebuilt": lambda flight: identify(TPP, rebuilt(flight)),
    "predicted": lambda flight: identify(TPP, records(flight, *EXCITATIONS)),
    "before": as_before,
}


def fitted(flights: Sequence[Sequence[planted.Run]]) -> dict[str, float]:
    """The table of one case; the rms of z by way."""
    means, errors, found = {}, {}, {}
    for way, of in WAYS.items():
        fits = [of(flight) for flight in flights]
        off = np.array([fit.model.values - TRUTH for fit in fits])
        z = off / np.array([np.sqrt(np.diag(fit.covariance)) for fit in fits])
        means[way], errors[way] = z.mean(axis=0), np.sqrt(np.mean(off**2, axis=0))
        found[way] = float(np.sqrt(np.mean(z**2)))
        beside = float(np.max(np.abs(means[way] - means["logged"])))
        ratio = float(np.exp(np.mean(np.log(errors[way] / errors["logged"]))))
        kinds = ", ".join(f"{count} {kind}" for kind, count in Counter(fit.instrument for fit in fits).items())
        print(
            f"    {way:10} z rms {found[way]:5.2f}  largest mean {np.max(np.abs(means[way])):5.2f} (less logged's "
            f"{beside:5.2f})  errors x{ratio:5.2f}  {kinds}",
            flush=True,
        )
    return found


def diagnosed(flights: Sequence[Sequence[planted.Run]]) -> None:
    ways = {
        "logged": records,
        "rebuilt": rebuilt,
        "not logged": lambda flight: records(flight, *EXCITATIONS),
    }
    for way, of in ways.items():
        said: Counter[str] = Counter()
        for flight in flights:
            one = diagnose(TPP, of(flight), chains=False)
            said[one.verdict + (f" ({one.reason})" if one.reason else "")] += 1
        print(f"    verdicts, {way:10} {', '.join(f'{count} {what}' for what, count in said.items())}", flush=True)


def study_feedback(flights: int = 20, seconds: float = 30.0, verdicts: int = 4) -> None:
    print(f"\n{flights} flights of four {seconds:g}-s chirps from seed {FIRST_SEED}")
    print(f"  (sampling error of a mean {flights**-0.5:.2f})")
    for case in CASES:
        print(f"  {case.name}")
        flown = fly(case, flights, seconds)
        found = fitted(flown)
        if verdicts:
            diagnosed(flown[:verdicts])
        for way in ("rebuilt", "predicted"):
            assert abs(found[way] - 1) < SPREAD + (2 * ALONE * flights) ** -0.5, (case.name, way)


if __name__ == "__main__":
    given = [int(word) for word in sys.argv[1:4]]
    study_feedback(*given)
