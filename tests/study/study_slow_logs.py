"""Exact TPP vehicles of a loop of 500 Hz in logs of 500 to 83 Hz: how far M_a is off, z of all numbers, the verdict.

    python tests/study/study_slow_logs.py

Vehicles, loops, gusts and logs are made without the package. Where the log does not tell of the loop, a fit has to find
out how long commands were held, and to say so; so has the diagnosis.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests"), str(ROOT / "tests" / "study")]

from planted import TABLE_4, Array  # noqa: E402
from strangers.asking import records, weighed  # noqa: E402
from study_findings import FIRST_SEED, Setting, asked, flown, said_of  # noqa: E402

from sysid.fit.identify import identify  # noqa: E402
from sysid.fit.result import Fit  # noqa: E402
from sysid.model.paper import TPP  # noqa: E402

BAND = (0.0, 15.0)
WAS = {1: "M_a +0.1 %, z 0.5", 2: "+1.7 %, 5.6", 4: "+4.9 %, 15", 5: "+6.6 %, 19.6", 6: "+8.1 %, 22.9"}
"""Samples of the loop for each in the log -> what an examination found."""
FITS, DIAGNOSES = 12, 3
"""Flights of each that are fitted, and of them diagnosed."""
TRUTH = np.array([TABLE_4[name] for name in TPP.names])
LARGEST_OFF, LARGEST_Z = 0.5, 1.2
"""Percent of M_a; rms of z."""


def slow_log(every: int, told: bool) -> tuple[bool, str]:
    fits, found_ms, said_so, verdicts = [], [], 0, Counter[str]()
    for i in range(FITS):
        runs = records(flown(Setting(every=every, told=told), FIRST_SEED + i))
        fit = identify(TPP, runs, band_hz=BAND)
        fits.append(_off(fit))
        found_ms += [] if fit.found_loop_s is None else [1000 * fit.found_loop_s]
        said_so += any("no log tells the rate of the vehicle's loop" in text for text in fit.warnings)
        if i < DIAGNOSES:
            verdicts[said_of(weighed(asked(runs)))] += 1
    good = _near(fits) and len(found_ms) == said_so == (0 if told else FITS)
    verdict = "; ".join(f"{count} x {one}" for one, count in verdicts.items())
    held = "" if told else f"; held for {np.mean(found_ms):.2f} ms ({np.min(found_ms):.2f} to {np.max(found_ms):.2f})"
    return good and all(one.startswith("complete") for one in verdicts), f"{_in_words(fits)}{held}; {verdict}"


def _off(fit: Fit) -> tuple[float, Array]:
    """M_a, percent; all, in standard errors."""
    return 100 * (fit.model["M_a"] / TABLE_4["M_a"] - 1), (fit.model.values - TRUTH) / fit.standard_errors


def _near(fits: Sequence[tuple[float, Array]]) -> bool:
    return max(abs(off) for off, _ in fits) < LARGEST_OFF and _rms(fits) < LARGEST_Z


def _rms(fits: Sequence[tuple[float, Array]]) -> float:
    return float(np.sqrt(np.mean([z**2 for _, z in fits])))


def _in_words(fits: Sequence[tuple[float, Array]]) -> str:
    off = [one for one, _ in fits]
    return f"M_a {np.mean(off):+.2f} % ({np.min(off):+.2f} to {np.max(off):+.2f}), z rms {_rms(fits):.2f}"


def study_slow_logs() -> None:
    failed = []
    for every, was in WAS.items():
        for told in (True, False) if every > 1 else (True,):
            right, said = slow_log(every, told)
            words = f"{500 / every:.0f} Hz, loop {'told' if told else 'not told'}"
            print(f"  {words:24}{was}; {said}{'' if right else '   NOT AS WANTED'}", flush=True)
            failed += [] if right else [words]
    assert not failed, f"not as wanted: {', '.join(failed)}"


if __name__ == "__main__":
    study_slow_logs()
