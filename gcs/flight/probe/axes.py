"""Signs and axes: are commands or rates reversed, exchanged, or turned against each other?

A rotor's own coupling turns the gains of both commands on both rates by some degrees, a swashplate or a gyro that is a
quarter turn off by 90, one reversed axis makes their determinant negative. So signs and axes are judged together, as
the nearest of the eight ways to exchange and reverse two axes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from scipy import signal

from gcs.flight.probe.fit import SEEN, Fit
from gcs.flight.probe.grid import GRID_S
from gcs.flight.probe.values import LETTERS, RATES, FloatArray, ProbeFinding

SURE = 3.0
"""Standard errors by which one way of exchanging axes must be better than another."""
TURNED_DEG = 45.0

_ATTITUDES = {"p": "phi", "q": "theta"}
_WAYS = tuple(
    np.array([[a, 0.0], [0.0, b]]) @ turn for turn in (np.eye(2), np.eye(2)[::-1]) for a in (1, -1) for b in (1, -1)
)
"""The eight ways to exchange and reverse two axes: rows p and q, columns delta_x and delta_y. The first is right."""


def axes_findings(fit: Fit) -> tuple[list[ProbeFinding], float | None]:
    """Reversed and swapped axes, and how far commands and rates are turned, degrees; None where that is not known."""
    mixing = _mixing(fit)
    findings = list(_mixing_findings(mixing))
    columns = [j for j in range(len(fit.letters)) if fit.signal_to_noise(j) >= SEEN]
    if not columns or len(fit.rates) < 2:
        return [*findings, *_reversed_alone(fit, columns)], None
    G = _even(fit.G[:, columns])
    way = _nearest(fit, G, columns)
    if way is not None:
        findings += _way_findings(way @ mixing, [fit.letters[j] for j in columns], _by_attitude(fit))
    if len(columns) < 2 or np.linalg.det(G) <= 0:
        return findings, None
    turn = math.degrees(math.atan2(G[1, 0] - G[0, 1], G[0, 0] + G[1, 1]))
    if not findings and abs(turn) > TURNED_DEG:
        findings.append(ProbeFinding(kind="turned", axis=None, serious=False, numbers={"turn_deg": turn}))
    return findings, turn


def _even(G: FloatArray) -> FloatArray:
    """Rows of one length: neither rate's inertia counts."""
    even: FloatArray = G / np.maximum(np.linalg.norm(G, axis=1, keepdims=True), 1e-12)
    return even


def _nearest(fit: Fit, G: FloatArray, columns: Sequence[int]) -> FloatArray | None:
    """The way of exchanging axes that is nearest to the gains; None where it does not surely beat being in order.

    `G` is of shape (2, len(columns)); the columns that were not seen are taken to be in order with those that were.
    """
    places = ["xy".index(fit.letters[j]) for j in columns]
    scores = [float(np.sum(way[:, places] * G)) for way in _WAYS]
    best = int(np.argmax(scores))
    order = scores[0]
    if best == 0:
        return _WAYS[0]
    scale = np.where(np.abs(fit.G[:, columns]) > 1e-12, G / np.where(fit.G[:, columns] == 0, 1, fit.G[:, columns]), 0)
    weights = np.zeros_like(fit.G)
    weights[:, columns] = (_WAYS[best] - _WAYS[0])[:, places] * scale
    error = math.sqrt(max(fit.variance(weights), 0.0))
    sure = scores[best] - order > SURE * error and order < 0.6 * scores[best]
    return _WAYS[best] if sure else None


def _reversed_alone(fit: Fit, columns: Sequence[int]) -> Iterator[ProbeFinding]:
    """With one rate only, its own command's sign is all that can be judged."""
    for j in columns:
        axis = {"x": "roll", "y": "pitch"}[fit.letters[j]]
        if RATES[axis] == fit.rates[0] and fit.rows[0].gain[j] < 0:
            yield ProbeFinding(kind="reversed", axis=axis)


def _way_findings(way: FloatArray, letters: Sequence[str], attitude: Mapping[str, str]) -> Iterator[ProbeFinding]:
    """What a way of exchanging axes means, for the columns that were seen."""
    if way[0, 0] == 0:
        names = {
            "pq"[i]: ("-" if way[i].sum() < 0 else "") + "delta_" + "yx"[i] for i in range(2) if "yx"[i] in letters
        }
        how = "gyro" if "swapped" in attitude.values() else ""
        yield ProbeFinding(kind="swapped", axis=None, how=how, names=names)
        return
    for i, axis in enumerate(("roll", "pitch")):
        if way[i, i] < 0 and "xy"[i] in letters:
            yield ProbeFinding(kind="reversed", axis=axis, how=attitude.get(RATES[axis], ""))


def _mixing(fit: Fit) -> FloatArray:
    """How what is added shows on the commands, as one of the eight ways: rows delta_x, delta_y, columns what is added.

    Ranked at the edges of what is added, where no feedback is as fast; in order where that is not known.
    """
    way = np.eye(2)
    for grid in fit.steps:
        j = "xy".index(LETTERS[grid.axis])
        added = grid.raw.get("excitation_" + "xy"[j])
        if added is None:
            continue
        edge = np.diff(added)
        power = float(edge @ edge)
        shows = [
            float(edge @ np.diff(grid.raw["delta_" + k])) / power if "delta_" + k in grid.raw else 0.0 for k in "xy"
        ]
        strongest = int(np.argmax(np.abs(shows)))
        if power > 0 and abs(shows[strongest]) > 0.5:
            way[:, j] = 0.0
            way[strongest, j] = math.copysign(1.0, shows[strongest])
    return way if abs(np.linalg.det(way)) > 0.5 else np.eye(2)


def _mixing_findings(mixing: FloatArray) -> Iterator[ProbeFinding]:
    if mixing[0, 0] == 0:
        yield ProbeFinding(kind="swapped", axis=None, how="mixing")
        return
    for i, axis in enumerate(("roll", "pitch")):
        if mixing[i, i] < 0:
            yield ProbeFinding(kind="reversed", axis=axis, how="mixing")


def _by_attitude(fit: Fit) -> dict[str, str]:
    """What the attitude says of each rate: `command` (the rate goes with it), `gyro` (against it) or `swapped`."""
    blame = {}
    for rate, angle in _ATTITUDES.items():
        shares = []
        for other in fit.rates:
            top = bottom = 0.0
            for grid in fit.steps:
                if angle in grid.raw and other in grid.raw:
                    turned = signal.detrend(np.cumsum(grid.raw[other]) * GRID_S)
                    moved = signal.detrend(grid.raw[angle])
                    top += float(turned @ moved)
                    bottom += float(turned @ turned) + 1e-30
            shares.append((top / bottom if bottom else 0.0, other))
        if not shares or all(share == 0 for share, _ in shares):
            continue
        share, other = max(shares, key=lambda pair: abs(pair[0]))
        blame[rate] = "swapped" if other != rate else "gyro" if share < 0 else "command"
    return blame
