"""The broken loop drawn: loci over frequency against -1, their size and phase, and how near the error comes."""

from __future__ import annotations

from typing import Any

import numpy as np

from gcs.analysis.pages.page import BLACK, BLUE, ORANGE
from gcs.analysis.pages.pictures import logarithmic, plain, sheet
from gcs.analysis.shadow import ShadowFlight
from sysid.control.measured_stability import BrokenLoop
from sysid.control.stability import branches

COLOURS = (BLUE, ORANGE)
STYLES = ("-", "--")
RADIUS = 2.5
"""Of what is drawn of the plane."""
EVERY = 12
"""Points of the fine grid between two bounds that are drawn."""


def shadow_picture(found: ShadowFlight) -> Any:
    """Nyquist's plane on the left, size, phase and reach on the right. Without a measured loop an empty sheet that says
    so."""
    figure = sheet(7.5)
    loop = found.stability.loop
    if loop is None:
        figure.text(0.5, 0.5, "the flights do not show the four responses of both axes", ha="center", fontsize=12)
        return figure
    grid = figure.add_gridspec(3, 2, width_ratios=[1.15, 1.0])
    plane = figure.add_subplot(grid[:, 0])
    size, phase, reach = (figure.add_subplot(grid[k, 1]) for k in range(3))
    for axis in (plane, size, phase, reach):
        plain(axis)
    loci = branches(np.asarray(np.linalg.eigvals(loop.loop), dtype=np.complex128))
    bound = loop.reach[:, None] * np.abs(1 + loci)
    model = branches(np.asarray(np.linalg.eigvals(loop.model), dtype=np.complex128))
    _plane(plane, loci, bound, model, loop)
    for k, (colour, style) in enumerate(zip(COLOURS, STYLES, strict=True)):
        f = loop.frequency_hz
        with np.errstate(divide="ignore"):
            size.plot(f, 20 * np.log10(np.abs(loci[:, k])), color=colour, linestyle=style, linewidth=1.6)
            size.plot(f, 20 * np.log10(np.abs(model[:, k])), color=colour, linewidth=0.8, linestyle=":")
        phase.plot(f, np.degrees(np.unwrap(np.angle(loci[:, k]))), color=colour, linestyle=style, linewidth=1.6)
    size.axhline(0, color=BLACK, linewidth=0.6)
    size.set_ylabel("size of the loci, dB", fontsize=10)
    phase.set_ylabel("phase, degrees", fontsize=10)
    reach.plot(loop.frequency_hz, 100 * loop.reach, color=BLACK, linewidth=1.4)
    reach.axhline(100, color=BLACK, linewidth=0.8, linestyle=":")
    reach.set_ylim(0, max(110.0, min(300.0, 110 * float(np.max(loop.reach)))))
    reach.set_ylabel("95 % bound, % of the way to -1", fontsize=10)
    reach.set_xlabel("frequency, Hz", fontsize=10)
    for axis in (size, phase, reach):
        logarithmic(axis, (0.99 * float(loop.frequency_hz[0]), 1.01 * float(loop.frequency_hz[-1])))
    for axis in (size, phase):
        axis.tick_params(labelbottom=False)
    return figure


def _plane(axis: Any, loci: Any, bound: Any, model: Any, loop: BrokenLoop) -> None:
    """Loci with circles of their bounds."""
    # heavier than NumPy itself to load: only where it is needed
    from matplotlib.patches import Circle

    turn = np.exp(1j * np.linspace(0, 2 * np.pi, 200))
    axis.plot(turn.real, turn.imag, color=BLACK, linewidth=0.6, linestyle=":")
    for k, (colour, style) in enumerate(zip(COLOURS, STYLES, strict=True)):
        axis.plot(loci[:, k].real, loci[:, k].imag, color=colour, linestyle=style, linewidth=1.8,
                  label=f"measured, locus {k + 1}")  # fmt: skip
        axis.plot(model[:, k].real, model[:, k].imag, color=colour, linewidth=0.8, linestyle=":",
                  label="the model's" if k == 0 else None)  # fmt: skip
        for at in range(0, loci.shape[0], EVERY):
            if abs(loci[at, k]) < 2 * RADIUS:
                axis.add_patch(
                    Circle((loci[at, k].real, loci[at, k].imag), bound[at, k], color=colour, alpha=0.12, lw=0)
                )
    axis.plot([-1], [0], marker="+", markersize=14, markeredgewidth=2, color=BLACK)
    axis.annotate("-1", (-1, 0), textcoords="offset points", xytext=(-14, 8), fontsize=11)
    axis.set_xlim(-RADIUS, RADIUS)
    axis.set_ylim(-RADIUS, RADIUS)
    axis.set_aspect("equal")
    axis.set_xlabel("real", fontsize=10)
    axis.set_ylabel("imaginary", fontsize=10)
    low, high = loop.frequency_hz[0], loop.frequency_hz[-1]
    axis.set_title(f"loop broken at both commands, {low:.2g} to {high:.2g} Hz", fontsize=12, loc="left",
                   fontweight="bold")  # fmt: skip
    axis.legend(loc="upper right", fontsize=9, title="discs: 95 % bounds", title_fontsize=9, framealpha=0.85)
