"""Doublets in a command: trains of jumps of one height (or twice that) within a sample or two, up and down."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gcs.logs.formats.tables import FloatArray

JUMP = 0.02
"""Of full command: smaller steps excite nothing."""
ABOVE_REST = 8.0
"""A jump over the root mean square of all other steps from sample to sample."""
SAME_HEIGHT = 0.1
"""Relative, of the jumps of a train. The controller does not answer within a sample, so jumps are as commanded."""
PULSE_S = (0.08, 3.0)
"""From jump to jump: shorter is noise, longer another maneuver."""
FEWEST_JUMPS = 3
SAME_LENGTH = 0.05
"""Of a pulse, from jump to jump, beside one sample."""
BETWEEN = (0.3, 0.7)
"""Of a jump: where a command has steps of this size too, they come from a hand or a controller."""

Train = tuple[float, float, float]  # start, stop, height of the jumps


def trains_in(t: FloatArray, values: FloatArray) -> list[Train]:
    """Where a command jumps up and down by one height."""
    step = np.diff(values)
    size = np.abs(step)
    rest = size[size <= np.quantile(size, 0.99)]
    least = max(JUMP, ABOVE_REST * float(np.sqrt(np.mean(rest**2))))
    jumps: list[tuple[float, float, float]] = []  # before, after, height
    for i in np.flatnonzero(size >= least).tolist():
        if jumps and t[i] <= jumps[-1][1] and step[i] * jumps[-1][2] > 0:  # one jump over two steps
            jumps[-1] = (jumps[-1][0], float(t[i + 1]), jumps[-1][2] + float(step[i]))
        else:
            jumps.append((float(t[i]), float(t[i + 1]), float(step[i])))
    trains: list[Train] = []
    chain: list[tuple[float, float, float]] = []
    for jump in jumps:
        if chain and not PULSE_S[0] <= jump[1] - chain[-1][1] <= PULSE_S[1]:
            trains += _train(chain, t, size)
            chain = []
        chain.append(jump)
    return trains + _train(chain, t, size)


def _train(chain: Sequence[tuple[float, float, float]], t: FloatArray, size: FloatArray) -> list[Train]:
    """The chain if its jumps are of one height or its small multiples and at multiples of one pulse's length.

    A chain is (before, after, height) of each jump; `size` those of all steps, (n - 1,), after `t`.
    """
    if len(chain) < FEWEST_JUMPS:
        return []
    heights = np.array([jump[2] for jump in chain])
    own = np.abs(heights)
    height = float(np.median(own[own <= 1.5 * own.min()]))
    levels = np.round(own / height)
    regular = (levels >= 1) & (levels <= 3) & (np.abs(own / height - levels) <= SAME_HEIGHT)
    back = abs(float(heights.sum())) <= (1 + SAME_HEIGHT) * height
    ways = int(np.count_nonzero(np.diff(np.sign(heights))))
    waits = np.diff([after for _, after, _ in chain])
    pulse = float(np.median(waits[waits <= 1.5 * waits.min()]))
    allowed = SAME_LENGTH * pulse + float(np.median(np.diff(t)))
    in_time = np.abs(waits - pulse * np.round(waits / pulse)) <= allowed
    if not (np.all(regular) and back and ways >= 2 and np.all(in_time)):
        return []
    first, last = np.searchsorted(t, [chain[0][0] - 1.0, chain[-1][1] + 1.0])
    around = size[first:last]
    if np.any((around > BETWEEN[0] * height) & (around < BETWEEN[1] * height)):
        return []
    return [(chain[0][1], chain[-1][1] + pulse, height)]
