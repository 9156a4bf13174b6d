"""The simulated vehicle's LQR asked for rates, as fast as it computes; and the same answered by a model, step by step.

The law is written out here again, so that neither the vehicle's nor the prediction's slips pass.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from flying import DOUBLET, log_of
from scipy.linalg import expm

from gcs.flight.gains import SHADOW, gains_of
from gcs.logs.formats import dataflash
from gcs.logs.formats.dataflash_table import DataFlashTables
from sitl.autopilot.modes import Mode, Reason
from sitl.autopilot.vehicle import Vehicle
from sysid.control.regulator import Gains
from sysid.data.preprocess import low_pass
from sysid.model.structure import Model

FloatArray = np.ndarray
DT = 0.002
RATE = 0.3
PULSE_S = 0.5
SMOOTH_HZ = 15.0
AXES = {"roll": 7, "pitch": 8}
BEGIN = {
    "SID_T_FADE_IN": 0.0, "SID_T_FADE_OUT": 0.0, "SID_T_REC": 3.0, "SIDX_KIND": DOUBLET, "SIDX_PULSE_S": PULSE_S,
    "SID_MAGNITUDE": float(np.degrees(RATE)),
}  # fmt: skip


@dataclass(frozen=True)
class Answered:
    """One doublet; arrays (n, 2) of p, q in rad/s, from its beginning on."""

    axis: int
    asked: FloatArray
    rates: FloatArray

    @property
    def coupling(self) -> float:
        """Largest rate of the other axis while it lasts, of what was asked; its own share of the asked taken off."""
        last = round(3 * PULSE_S / DT)
        return float(np.max(np.abs(self.rates[:last, 1 - self.axis]))) / RATE

    @property
    def rise_s(self) -> float:
        """To eight tenths of the asked: the attitude that is held asks for less by then."""
        return DT * float(np.flatnonzero(self.rates[:, self.axis] >= 0.8 * RATE)[0])


def commit(vehicle: Vehicle, gains: Gains) -> None:
    """Into its bank, as a push does."""
    held = gains_of(gains.to_json())
    for name, value in held.values.items():
        assert vehicle.write_parameter(SHADOW + name, value) is not None, name
    answer = vehicle.write_parameter("LQR_COMMIT", float(held.crc))
    assert answer is not None
    assert answer.value == held.crc, answer.text


def fly_doublets(vehicle: Vehicle, folder: Path, times: int = 1) -> list[list[Answered]]:
    """Of roll and pitch, each so often, with the LQR on; from take-off to a closed log."""
    assert vehicle.take_off() is None
    for _ in range(4000):
        vehicle.step()
    assert vehicle.select_lqr(True) is None
    begun: list[tuple[int, float]] = []
    for _ in range(times):
        for axis, number in enumerate(AXES.values()):
            for _ in range(1500):
                vehicle.step()
            for name, value in {"SID_AXIS": number, **BEGIN}.items():
                assert vehicle.write_parameter(name, value) is not None
            assert vehicle.set_mode(Mode.SYSTEMID, Reason.GROUND)
            begun.append((axis, vehicle.time_s))
            while vehicle.sweeping:
                vehicle.step()
            assert vehicle.set_mode(Mode.STABILIZE, Reason.GROUND)
    path = log_of(vehicle, folder)
    log = DataFlashTables(dataflash.read(path).boots[-1], str(path))
    fields = [log.series(f"RATE.{name}") for name in ("RDes", "PDes", "R", "P")]
    found: list[list[Answered]] = [[], []]
    for axis, start in begun:
        p_ref, q_ref, p, q = (np.radians(one.part(start, start + 4.5).values) for one in fields)
        first = int(np.flatnonzero(np.abs((p_ref, q_ref)[axis]) > 0.6 * RATE)[0])
        asked, rates = np.stack([p_ref, q_ref], axis=1)[first:], smooth(np.stack([p, q], axis=1))[first:]
        found[axis].append(Answered(axis, asked, rates))
    return found


def smooth(rates: FloatArray) -> FloatArray:
    """Without the rotor's vibration, as the paper takes its measurements."""
    return np.stack([low_pass(one, DT, SMOOTH_HZ) for one in rates.T], axis=1)


def answered(gains: Gains, vehicle: Model, asked: FloatArray) -> FloatArray:
    """(n, 2): p, q of a model without delay under the gains, each command held over a sample."""
    A, B, C = (np.asarray(one, dtype=float) for one in vehicle.matrices[:3])
    inputs = vehicle.structure.inputs
    B = B[:, [inputs.index(name) for name in ("delta_x", "delta_y", "delta_e")[: len(gains.K)]]]
    a, b, c = (np.asarray(one, dtype=float) for one in gains.model.matrices[:3])
    b, L, k = b[:, : len(gains.K)], gains.observer_gain, len(gains.K)
    plant, own = _held(A, B), _held(a - L @ c, np.hstack([b, L]))
    F, models = np.zeros((k, 4)), [(np.zeros((2, 2)), np.zeros((2, 1)))] * 2
    if gains.dynamic is not None:
        F = gains.dynamic.F
        models = [
            _held(np.array([[0.0, 1.0], [-w * w, -2 * zeta * w]]), np.array([[0.0], [w * w]]))
            for w, zeta in zip(gains.dynamic.frequency, gains.dynamic.damping, strict=True)
        ]
    x, x_hat, z, out = np.zeros(len(A)), np.zeros(4), np.zeros((2, 2)), []
    for r in asked:
        y = (C @ x)[:2]
        out.append(y)
        u = -gains.K @ x_hat + gains.prefilter @ r + F @ np.concatenate([z[:, 0] - r, z[:, 1]])
        x, x_hat = plant[0] @ x + plant[1] @ u, own[0] @ x_hat + own[1] @ np.concatenate([u, y])
        z = np.array([one[0] @ z[i] + one[1][:, 0] * r[i] for i, one in enumerate(models)])
    return smooth(np.array(out))


def _held(A: FloatArray, B: FloatArray) -> tuple[FloatArray, FloatArray]:
    n, m = B.shape
    whole = np.zeros((n + m, n + m))
    whole[:n, :n], whole[:n, n:] = A * DT, B * DT
    step = expm(whole)
    return step[:n, :n], step[:n, n:]
