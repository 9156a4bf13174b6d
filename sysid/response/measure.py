"""Measured frequency responses, several inputs at once, from all runs together, and how far to trust them.

Narrow windows are noisy, wide ones blur what bends within them. So each response is measured in windows of several
widths, and where a wider one differs from the narrowest by more than chance lets it, it is blurred. All are averaged,
weighed by one over the square of their variance, blur included, as CIFER's composite windows are weighed by their
random errors (Tischler and Remple, Aircraft and Rotorcraft System Identification, ch. 10).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from sysid.data.preprocess import ComplexArray, Spectrum
from sysid.data.record import RATES, FloatArray
from sysid.data.stacks import stack
from sysid.response.values import BoolArray, Responses
from sysid.response.windows import POINTS, Solution, Windows, windows

WINDOWS = ((0.0625, 1), (0.125, 1), (0.25, 2), (0.5, 2), (1.0, 2))
"""Half widths in Hz, where frequencies are low, and what polynomial a response may be there; a wide one may bend."""
FEWEST_BINS = 2
"""For each unknown: narrow windows are wanted where noise is small, and where it is not they weigh nothing."""
BLUR_OF_DIFFERENCE, BLUR_OF_NARROWEST = 16 / 9, 1 / 9
"""Squares of the blur over that of the difference of two windows, one twice as wide: it goes with the width squared."""

NEIGHBOURS = 5
"""Points of the grid over which blur is averaged; it does not jump from one to the next."""
TINY = 1e-300


def measure(
    spectra: Sequence[Spectrum],
    commands: Sequence[str],
    outputs: Sequence[str] = RATES,
    points: int = POINTS,
    within_hz: tuple[float, float] | None = None,
) -> Responses:
    """Responses of the outputs to the commands, from the bins of all runs together.

    `within_hz` is where they are wanted, in Hz; the bins may reach further.
    """
    stacks = stack(spectra)
    Y = np.concatenate([group.Y for group in stacks], axis=1)
    cuts = [
        windows(stacks, commands, points, half, order=order, fewest=FEWEST_BINS, ends=True, within_hz=within_hz)
        for half, order in WINDOWS
    ]
    return composite(cuts, [cut.solve(Y) for cut in cuts], tuple(outputs))


def judged(cut: Windows, outputs: tuple[str, ...], of: Solution) -> Responses:
    """Responses in windows of one width, with their coherences."""
    return composite([cut], [of], outputs)


def composite(cuts: Sequence[Windows], found: Sequence[Solution], outputs: tuple[str, ...]) -> Responses:
    """Windows of several widths, from narrow to wide, put together."""
    H = np.stack([one.H for one in found])
    widths = np.broadcast_to(np.stack([cut.half_width_hz for cut in cuts])[:, None, None], H.shape)
    variance = np.where(_separated(found)[:, None], np.stack([one.variance for one in found]), np.nan)
    variance = np.maximum(variance + blur(H, variance, widths), TINY)
    known = np.isfinite(variance)
    least = np.min(np.where(known, variance, np.inf), axis=0)
    weight = np.where(known, np.divide(least, variance, out=np.zeros_like(variance), where=known) ** 2, 0.0)
    freedom = np.stack([_freedom(cut) for cut in cuts])[:, None, None]
    both = [cut.coherences(one) for cut, one in zip(cuts, found, strict=True)]
    return Responses(
        frequency_hz=cuts[0].frequency_hz,
        outputs=outputs,
        commands=cuts[0].commands,
        H=_mean(weight, H),
        # of estimates that err together, the mean errs no more than their mean square says
        error=np.sqrt(_mean(weight, variance)),
        freedom=_mean(weight, np.broadcast_to(freedom, H.shape)),
        half_width_hz=_mean(weight, widths),
        multiple_coherence=_mean(np.max(weight, axis=2), np.stack([multiple for multiple, _ in both])),
        partial_coherence=_mean(weight, np.stack([partial for _, partial in both])),
        references=cuts[0].references,
    )


def _separated(found: Sequence[Solution]) -> BoolArray:
    """(1, m, f): which commands move for themselves in every window that there is; in narrow ones some do by chance."""
    there = np.stack([np.any(np.isfinite(one.noise), axis=0) for one in found])[:, None]
    each = ~there | np.stack([np.isfinite(one.own) for one in found])
    return np.asarray(np.all(each, axis=0, keepdims=True))


def blur(H: ComplexArray, variance: FloatArray, widths: FloatArray) -> FloatArray:
    """Square of what bends within each window, (widths, k, m, f), by the difference from the narrowest there is.

    Nothing is known of a window that stands alone.
    """
    first = np.argmax(np.isfinite(variance), axis=0)[None]
    H0, variance0, width0 = (np.take_along_axis(x, first, axis=0) for x in (H, variance, widths))
    # what a narrower window adds by chance is the difference of their variances
    beyond = np.abs(H - H0) ** 2 - np.abs(variance0 - variance)
    wider = np.isfinite(beyond) & (widths > 1.01 * width0)
    beyond = np.maximum(_smooth(np.where(wider, beyond, np.nan)), 0)
    found = beyond * BLUR_OF_DIFFERENCE
    second = np.argmax(wider, axis=0)[None]
    own = np.take_along_axis(beyond * BLUR_OF_NARROWEST, second, axis=0)
    return np.where(np.isfinite(variance), np.where(wider, found, own), np.nan)


def _smooth(values: FloatArray) -> FloatArray:
    """Means (..., f) over neighbouring points, of those that are numbers; 0 where none is."""
    there = np.isfinite(values)
    room = [(0, 0)] * (values.ndim - 1) + [(NEIGHBOURS // 2, NEIGHBOURS // 2)]
    total, count = (
        np.lib.stride_tricks.sliding_window_view(np.pad(x, room), NEIGHBOURS, axis=-1).sum(axis=-1)
        for x in (np.where(there, values, 0.0), there.astype(float))
    )
    return np.asarray(np.where(there, total / np.maximum(count, 1), 0.0))


def _freedom(cut: Windows) -> FloatArray:
    """(f,), how many numbers the noise of each window was measured from."""
    return np.array([np.nan if one is None else 2.0 * one.freedom for one in cut.regressions])


def _mean(weight: FloatArray, values: Any) -> Any:
    """Over the widths; NaN where nothing has a weight."""
    whole = np.sum(weight, axis=0)
    total = np.sum(np.where(weight > 0, weight * np.where(weight > 0, values, 0), 0), axis=0)
    return np.where(whole > 0, total / np.where(whole > 0, whole, 1.0), np.nan)
