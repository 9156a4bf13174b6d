"""Eq. 1, the controller of the work before the paper: what its K_c does on the model that it believes in (CD), and on
the one that flies (TPP). K_c = 1 should cancel the coupling; in flight 0.5 was best, which the paper asks about.

delta = G^-1 [K_p p_err + q C_qp K_c, K_q q_err + p C_pq K_c], with G, C_qp = -L_q and C_pq = -M_p of the CD.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

from gcs.paper.rows import PRINTED, panel
from gcs.paper.values import PaperFigure, PaperTable, Row
from sysid.model.paper import reduce_to_cd
from sysid.model.structure import FloatArray, Model

K_C = (0.0, 0.25, 0.5, 0.75, 1.0)
RATE_GAINS = (1.0, 2.0, 3.0, 5.0)
"""K_p = K_q, 1/s, which the paper does not print."""
DRAWN_GAIN = 2.0
OF_REDUCED = "TPP, law of its reduction"
"""The law with G and C of the CD that the TPP itself reduces to (section 3.3)."""
STEP = 0.3
"""rad/s of roll rate asked for."""
DRAWN_S = 2.0
DT = 0.005
LARGEST = 3.0
"""rad/s: a line that has diverged so far is drawn no further."""


def closed(plant: Model, cd: Model, rate_gain: float, k_c: float) -> tuple[FloatArray, FloatArray]:
    """A (n, n) of the plant under eq. 1, and B (n, 2) from the rates asked for; the law knows only the CD."""
    A, B, C, _ = (np.asarray(one, dtype=float) for one in plant.matrices)
    A_cd, G = (np.asarray(one, dtype=float) for one in cd.matrices[:2])
    cross = k_c * np.array([[0.0, -A_cd[0, 1]], [-A_cd[1, 0], 0.0]])
    errors = rate_gain * np.eye(2)
    closed_A = np.asarray(A + B @ np.linalg.solve(G, (cross - errors) @ C), dtype=float)
    return closed_A, np.asarray(B @ np.linalg.solve(G, errors), dtype=float)


def growth(plant: Model, cd: Model, rate_gain: float, k_c: float) -> float:
    """The largest real part of the closed loop's poles, 1/s: stable below zero."""
    return float(np.max(np.linalg.eigvals(closed(plant, cd, rate_gain, k_c)[0]).real))


def coupled(cd: Model, rate_gain: float, k_c: float) -> float:
    """What is left of the coupling on the CD: the larger cross term of its closed loop over that without K_c."""
    A, bare = closed(cd, cd, rate_gain, k_c)[0], closed(cd, cd, rate_gain, 0.0)[0]
    return max(abs(float(A[i, k] / bare[i, k])) for i, k in ((0, 1), (1, 0)))


def coupling_table(tpp: Model, cd: Model) -> PaperTable:
    """Growth on both plants over K_c: printed models, then those of the flight."""
    rows = []
    for gain in RATE_GAINS:
        for k_c in K_C:
            beside: dict[str, float | None] = {
                "CD, growth 1/s": growth(PRINTED["CD"], PRINTED["CD"], gain, k_c),
                "CD, coupling left": coupled(PRINTED["CD"], gain, k_c),
                "TPP, growth 1/s": growth(PRINTED["TPP"], PRINTED["CD"], gain, k_c),
                OF_REDUCED: growth(PRINTED["TPP"], reduce_to_cd(PRINTED["TPP"]), gain, k_c),
                "our TPP, growth 1/s": growth(tpp, cd, gain, k_c),
            }
            rows.append(Row(name=f"gain {gain:g} 1/s, K_c = {k_c:g}", beside=beside, digits=2))
    return PaperTable(
        label="Eq. 1, K_c",
        caption="Eq. 1 with G and C of the CD, on the CD and on the TPP: largest real part of the poles, stable below "
        "zero; gain: K_p = K_q. Table 4's models, then those fitted to our chirps.",
        rows=tuple(rows),
        columns=("CD, growth 1/s", "CD, coupling left", "TPP, growth 1/s", OF_REDUCED, "our TPP, growth 1/s"),
        shows_percent=False,
        shows_values=False,
        why=_why(tpp, cd),
    )


def _why(tpp: Model, cd: Model) -> tuple[str, ...]:
    printed = {k_c: growth(PRINTED["TPP"], PRINTED["CD"], DRAWN_GAIN, k_c) for k_c in K_C}
    own = reduce_to_cd(PRINTED["TPP"])
    reduced = {k_c: growth(PRINTED["TPP"], own, DRAWN_GAIN, k_c) for k_c in K_C}
    ours = {k_c: growth(tpp, cd, DRAWN_GAIN, k_c) for k_c in K_C}
    left = coupled(PRINTED["CD"], DRAWN_GAIN, 1.0)
    return (
        f"On the CD, K_c = 1 leaves {100 * left:.0f} % of the coupling, as eq. 1 intends, and every K_c is stable.",
        f"On Table 4's TPP with {DRAWN_GAIN:g} 1/s: {_stability(printed)}. So {_most(printed)} is the most that "
        "flies, and "
        "the paper's best in flight, 0.5, is what its own two models say. It holds for gains up to about 2 1/s; "
        "above, less "
        "K_c is too much already.",
        f"It is not cancelling as such that diverges: with G and C of the CD that the TPP itself reduces to, "
        f"{_stability(reduced)}. The fitted CD's numbers stand in for a mode that it lacks (Table 2: 1.54 Hz, its TPP "
        "reduced 2.74 Hz); a law that takes them for the vehicle's inverts what is not there.",
        f"The models fitted to our chirps: {_stability(ours)}.",
    )


def _most(found: dict[float, float]) -> str:
    return f"K_c = {max(k_c for k_c, value in found.items() if value < 0):g}"


def _stability(found: dict[float, float]) -> str:
    return ", ".join(
        f"K_c = {k_c:g} {'is stable' if value < 0 else 'diverges'} ({value:+.2f} 1/s)" for k_c, value in found.items()
    )


def coupling_figure() -> PaperFigure:
    """A step of the roll rate asked for under eq. 1: q, which should stay still, on both of Table 4's models."""
    panels = []
    for name, plant in PRINTED.items():
        lines = []
        for k_c in K_C:
            t, rates = stepped(plant, PRINTED["CD"], DRAWN_GAIN, k_c)
            gone = np.flatnonzero(np.abs(rates[:, 1]) > LARGEST)
            last = int(gone[0]) if gone.size else t.size
            lines.append((f"K_c = {k_c:g}", t[:last], rates[:last, 1]))
        panels.append(panel(f"q on the {name}, rad/s", lines))
    return PaperFigure(
        label="Eq. 1",
        caption=f"A step of {STEP:g} rad/s in the roll rate asked for, K_p = K_q = {DRAWN_GAIN:g} 1/s: the pitch rate "
        "that it causes. Lines that leave the panel have diverged.",
        panels=tuple(panels[::-1]),
        x="time, s",
    )


def stepped(plant: Model, cd: Model, rate_gain: float, k_c: float) -> tuple[FloatArray, FloatArray]:
    """Time (n,) and p, q (n, 2), from rest."""
    A, B = closed(plant, cd, rate_gain, k_c)
    n = A.shape[0]
    whole = np.zeros((n + 1, n + 1))
    whole[:n, :n], whole[:n, n] = A, B @ np.array([STEP, 0.0])
    step, state = np.asarray(expm(whole * DT), dtype=float), np.eye(n + 1)[n]
    states = [state]
    for _ in range(round(DRAWN_S / DT)):
        states.append(step @ states[-1])
    t = np.asarray(DT * np.arange(len(states)), dtype=float)
    return t, np.asarray(np.array(states)[:, :2], dtype=np.float64)
