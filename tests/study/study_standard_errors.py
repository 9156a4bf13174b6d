"""Standard errors are honest: over many closed-loop flights the estimates scatter as they say, about the truth.

Gusts are coloured and the controller is on, so they reach the commands. The excitation is logged and serves as
instrument; the last column is what least squares alone, without it, would be off by.
"""

from __future__ import annotations

import numpy as np
from planted import TABLE_4, fly_many
from planted_fits import in_standard_errors, records

from sysid.fit.identify import identify
from sysid.model.paper import TPP

FLIGHTS = 200
AT_ONCE = 50
EXCITATIONS = ("excitation_x", "excitation_y", "excitation_e")
SPREAD = (0.9, 1.1)
LARGEST_MEAN = 0.3


def study_standard_errors_of_closed_loop_flights() -> None:
    z, z_without = [], []
    for first in range(0, FLIGHTS, AT_ONCE):
        for flight in fly_many(None, {}, seeds=range(first, first + AT_ONCE)):
            z.append(list(in_standard_errors(identify(TPP, records(flight)), TABLE_4).values()))
            blind = identify(TPP, records(flight, *EXCITATIONS))
            z_without.append(list(in_standard_errors(blind, TABLE_4).values()))
    of_all = np.array(z)
    mean, spread = of_all.mean(axis=0), of_all.std(axis=0, ddof=1)
    print(
        f"\nz = (estimate - truth)/standard error over {FLIGHTS} closed-loop flights of four 30-s chirps in gusts"
        f"\n  (sampling error of a mean {FLIGHTS**-0.5:.2f}, of a spread {(2 * FLIGHTS) ** -0.5:.2f})"
    )
    print(f"  {'parameter':10} {'mean':>6} {'spread':>7} {'within 3':>9}   mean without instrument")
    for i, name in enumerate(TPP.names):
        share = np.mean(np.abs(of_all[:, i]) < 3)
        print(f"  {name:10} {mean[i]:+6.2f} {spread[i]:7.3f} {share:9.1%}   {np.mean(z_without, axis=0)[i]:+.2f}")
    print(f"  all, pooled {np.sqrt(np.mean(spread**2)):14.3f} {np.mean(np.abs(of_all) < 3):9.1%}")
    assert np.all((spread > SPREAD[0]) & (spread < SPREAD[1]))
    assert np.all(np.abs(mean) < LARGEST_MEAN)
