"""Forward flight: Table 5's TPP from three chirps, roll, pitch, elevator; L_b and M_a held, as the paper did, and free.

Held are the hover values of Table 4, 0.002 off those of Table 5 that flew.
"""

from __future__ import annotations

import numpy as np
from planted import PLANTED, TABLE_4, TABLE_5, fly_many
from planted_fits import FORWARD_FLIGHT, in_standard_errors, records

from sysid.fit.identify import identify
from sysid.model.paper import TPP

FLIGHTS = 100
AT_ONCE = 20
THREE_CHIRPS = slice(0, 3)
HELD = {name: TABLE_4[name] for name in ("L_b", "M_a")}


def study_table_5_from_three_chirps() -> None:
    z: dict[str, list[list[float]]] = {"held": [], "free": []}
    shown = {}
    for first in range(0, FLIGHTS, AT_ONCE):
        for flight in fly_many("elevator", PLANTED["elevator"], seeds=range(first, first + AT_ONCE), forward=True):
            runs = records(flight[THREE_CHIRPS])
            for word, fixed in (("held", HELD), ("free", {})):
                fit = identify(TPP, runs, effects=FORWARD_FLIGHT, fixed=fixed)
                shown.setdefault(word, fit)
                off = in_standard_errors(fit, TABLE_5)
                z[word].append([off[name] for name in TABLE_5 if name not in fixed])
    print(f"\nTable 5 from three chirps (roll, pitch, elevator); one flight, and z over {FLIGHTS} flights")
    print(f"  {'':8} {'Table 5':>9} | {'L_b, M_a held':>20} {'z mean, spread':>16} | ", end="")
    print(f"{'all free':>20} {'z mean, spread':>16}")
    for name, truth in TABLE_5.items():
        print(f"  {name:8} {truth:9.6g}", end="")
        for word, fixed in (("held", HELD), ("free", {})):
            fit = shown[word]
            i = fit.model.structure.names.index(name)
            if name in fixed:
                print(f" | {fit.model.values[i]:9.6g}   {'held':>9} {'':16}", end="")
                continue
            own = np.array(z[word])[:, [one for one in TABLE_5 if one not in fixed].index(name)]
            print(f" | {fit.model.values[i]:9.4g} ± {fit.standard_errors[i]:8.2g}", end="")
            print(f" {own.mean():+9.2f}, {own.std(ddof=1):5.2f}", end="")
        print()
    for word, fit in shown.items():
        modes = ", ".join(f"{mode.frequency_hz:.3f} Hz / {mode.damping_ratio:.3f}" for mode in fit.model.modes)
        nrmse = " / ".join(f"{value:.1f}" for value in fit.nrmse_percent.values())
        share = np.mean(np.abs(np.array(z[word])) < 3)
        print(f"  {word}: modes {modes} (Table 5: 1.762/.454, 4.622/.221); NRMSE {nrmse} %; {share:.1%} within 3")
        for warning in fit.warnings:
            print(f"    said: {warning}")
        assert share >= 0.99
