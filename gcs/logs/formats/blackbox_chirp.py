"""The chirps that Betaflight (2025.12 and later) and INAV fly themselves, out of the debug fields of a blackbox log.

Both need debug_mode CHIRP, whose number differs from release to release: it is told by what stands in the fields, which
must agree with each other. The columns made are `chirp.axis` (0 roll, 1 pitch, 2 yaw; -1 while none is flown),
`chirp.active` (0 or 1), `chirp.excitation` (what is added to the rate's setpoint, before Betaflight's lag filter, in
parts of the largest) and `chirp.f_start_hz`, `chirp.f_stop_hz` (of the chirp that is flown: where it was ended early,
what it came to).

- Betaflight after pull request 15113: debug[0] the phase times 5000, [1] the axis or -1, [2] ten times the frequency,
  [3] a thousand times the excitation.
- Betaflight before it: debug[0] alone. The excitation is the cosine of the phase, below 1 Hz times the frequency; the
  axis is the one in whose setpoint it shows.
- INAV: debug[0] the state (3 while it sweeps), [1] the axis from 1, [2] and [3] a hundred times the output in deg/s and
  the frequency.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from gcs.logs.formats.blackbox_header import Header
from gcs.logs.formats.columns import Column
from gcs.logs.formats.tables import FloatArray, stretches

PHASE, FREQUENCY, EXCITATION = 5e3, 10.0, 1e3
INAV_RUNNING, INAV_STATES, INAV_SCALE, INAV_FASTEST_HZ, INAV_LARGEST = 3, 5, 100.0, 60.0, 30.0
TURN = round(PHASE * 2 * np.pi)
SHORTEST = 50
"""Samples of a chirp."""


def chirp_columns(columns: Mapping[str, Column], header: Header, t: FloatArray) -> dict[str, FloatArray]:
    """Name -> values at t, each of shape (n,); empty where none was flown."""
    names = [f"debug[{place}]" for place in range(4)]
    if any(name not in columns for name in names) or t.size < SHORTEST:
        return {}
    debug = np.array([columns[name].stored for name in names], np.float64)
    if header.settings.get("Firmware revision", "").startswith("INAV"):
        found = _inav(debug)
    else:
        found = _told(debug) or _phase_alone(debug, columns, header, t)
    if found is None or not np.any(found[0] >= 0):
        return {}
    axis, frequency_hz, excitation = found
    edges = np.zeros((2, t.size))
    for start, stop in stretches(axis >= 0):
        edges[:, start:stop] = [[np.min(frequency_hz[start:stop])], [np.max(frequency_hz[start:stop])]]
    return {
        "chirp.axis": axis,
        "chirp.active": (axis >= 0).astype(np.float64),
        "chirp.excitation": np.where(axis >= 0, excitation, 0.0),
        "chirp.f_start_hz": edges[0],
        "chirp.f_stop_hz": edges[1],
    }


Found = tuple[FloatArray, FloatArray, FloatArray]
"""Axis, frequency in Hz and excitation, each (n,)."""


def _told(debug: FloatArray) -> Found | None:
    """Betaflight's newer fields; None where these are others."""
    phase, axis, deci_hz, mille = debug
    frequency_hz, excitation = deci_hz / FREQUENCY, mille / EXCITATION
    flown = (axis >= 0) & (axis <= 2) & (deci_hz > 0)
    expected = np.where(flown, np.cos(phase / PHASE) * np.minimum(frequency_hz, 1.0), 0.0)
    if not flown.any() or not _mostly((axis >= -1) & (axis <= 2)) or not _mostly(np.abs(excitation - expected) < 0.1):
        return None
    return np.where(flown, axis, -1.0), frequency_hz, excitation


def _phase_alone(debug: FloatArray, columns: Mapping[str, Column], header: Header, t: FloatArray) -> Found | None:
    """Betaflight's older fields; None where these are others."""
    phase = debug[0]
    alone = (phase >= 0) & (phase <= TURN) & ~np.any(debug[1:], axis=0)
    if not _mostly(alone) or np.count_nonzero(phase) < SHORTEST:
        return None
    setpoints = [columns[name].stored for name in (f"setpoint[{place}]" for place in range(3)) if name in columns]
    low, high = (header.number(f"chirp_frequency_{end}_deci_hz") / FREQUENCY for end in ("start", "end"))
    lasts_s = header.number("chirp_time_seconds")
    if len(setpoints) < 3 or not 0 < low < high or lasts_s <= 0:
        return None
    axis, frequency_hz = np.full(t.size, -1.0), np.zeros(t.size)
    for start, stop in stretches(_joined(phase != 0)):
        if stop - start < SHORTEST:
            continue
        here = slice(start, stop)
        wave = np.exp(1j * phase[here] / PHASE)
        shown = [abs(np.vdot(wave, one[here] - np.mean(one[here]))) for one in setpoints]
        axis[here] = float(np.argmax(shown))
        frequency_hz[here] = low * (high / low) ** ((t[here] - t[start]) / lasts_s)
    return axis, frequency_hz, np.cos(phase / PHASE) * np.minimum(frequency_hz, 1.0)


def _inav(debug: FloatArray) -> Found | None:
    state, axis, output, frequency = debug
    running = (state == INAV_RUNNING) & (axis >= 1) & (axis <= 3)
    possible = (state >= 0) & (state <= INAV_STATES) & (axis >= 0) & (axis <= 3) & (running | (output == 0))
    if not running.any() or not _mostly(possible & (frequency <= INAV_SCALE * INAV_FASTEST_HZ + 1)):
        return None
    return np.where(running, axis - 1, -1.0), frequency / INAV_SCALE, output / INAV_SCALE / INAV_LARGEST


def _mostly(mask: NDArray[np.bool_]) -> bool:
    """But for damage."""
    return float(np.mean(mask)) > 0.99


def _joined(on: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """With single samples in between: a phase may be zero by chance."""
    out = on.copy()
    out[1:-1] |= on[:-2] & on[2:]
    return out
