"""The multirotor base and axes taken from it, judged on motions that scipy integrated, not the code that fits them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

import sysid
from sysid.data.airframe import Airframe
from sysid.data.dataset import prepared
from sysid.data.record import FloatArray, Record
from sysid.errors import FitError
from sysid.fit.axes import excited_alone
from sysid.model.base import BaseError, find_base, on_axes
from sysid.model.compose import compose

DT = 0.004
BAND_HZ = (0.5, 10.0)
TRUTH = {"roll": (-2.0, 310.0), "pitch": (-1.2, 240.0)}
TAU_S = 0.06
T: FloatArray = DT * np.arange(8000, dtype=np.float64)
CHIRP: FloatArray = 0.05 * np.sin(2 * np.pi * (0.5 * T + 0.15 * T**2)) * (T < 31)


def answer(axis: str, command: FloatArray) -> FloatArray:
    """The rate of k/((s - damping)(tau s + 1)), its command held over each sample."""
    damping, k = TRUTH[axis]
    plant = ([k], np.polymul([TAU_S, 1.0], [1.0, -damping]))
    numerator, denominator, _ = cont2discrete(plant, DT, "zoh")
    return np.asarray(lfilter(np.ravel(numerator), denominator, command), np.float64)


def flown(
    axis: str, seed: int, *, other: float = 0.0, coupled: float = 0.0, airframe: Airframe | None = None
) -> sysid.Record:
    """A sweep of one axis; `other`: rms of the other command, `coupled`: share of this rate in the other one's."""
    rng = np.random.default_rng(seed)
    swept: dict[str, FloatArray] = {"roll": CHIRP, "pitch": other * rng.standard_normal(T.size)}
    if axis == "pitch":
        swept = {"roll": swept["pitch"], "pitch": CHIRP}
    p, q = answer("roll", swept["roll"]), answer("pitch", swept["pitch"])
    noise: FloatArray = 0.02 * max(np.std(p), np.std(q)) * rng.standard_normal((2, T.size))
    channels: dict[str, FloatArray] = {"t": T, "delta_x": swept["roll"], "delta_y": swept["pitch"]}
    channels |= {"p": p + noise[0], "q": q + coupled * p + noise[1]}
    return Record(axis, channels, maneuver="chirp", axis=axis, airframe=airframe)


def test_both_axes_and_their_motors_are_found() -> None:
    fit = sysid.fit_model([flown("roll", 1), flown("pitch", 2)], "multirotor", band_hz=BAND_HZ)
    assert fit.model["tau_m"] == pytest.approx(TAU_S, rel=0.02)
    for names, axis in ((("L_p", "L_lat"), "roll"), (("M_q", "M_lon"), "pitch")):
        damping, k = (fit.model[name] for name in names)
        assert k == pytest.approx(TRUTH[axis][1], rel=0.02)
        assert damping == pytest.approx(TRUTH[axis][0], abs=0.15)
    assert min(fit.nrmse_percent.values()) > 95


def test_an_integrator_behind_motors_is_a_damping_held_at_none() -> None:
    fit = sysid.fit_model(
        [flown("roll", 3), flown("pitch", 4)], "multirotor", band_hz=BAND_HZ, fixed={"L_p": 0.0, "M_q": 0.0}
    )
    assert fit.model["L_p"] == fit.model["M_q"] == 0.0
    assert fit.model["tau_m"] == pytest.approx(TAU_S, rel=0.15)


def test_it_is_cylinder_dynamics_behind_motors_without_coupling() -> None:
    runs = [flown("roll", 5), flown("pitch", 6)]
    apart = sysid.fit_model(runs, "multirotor", band_hz=BAND_HZ)
    whole = sysid.fit_model(runs, "cd", ["motor_lag"], band_hz=BAND_HZ)
    for name in apart.model.structure.names:
        assert apart.model[name] == pytest.approx(whole.model[name], rel=0.02, abs=0.05), name


@pytest.mark.parametrize("axis", ["roll", "pitch"])
def test_one_axis_of_it_is_that_axis_behind_motors(axis: str) -> None:
    base, contained = on_axes(find_base("multirotor"), [axis])
    assert (base.name, contained) == (axis, ("motor_lag",))
    fit = sysid.fit_model([flown(axis, 7)], base.name, contained, band_hz=BAND_HZ)
    assert fit.model["tau_m"] == pytest.approx(TAU_S, rel=0.03)
    assert fit.model[base.parameters[1].name] == pytest.approx(TRUTH[axis][1], rel=0.03)


def test_axes_that_a_base_has_not_are_refused_with_those_it_has() -> None:
    cd = find_base("cd")
    assert on_axes(cd, ["pitch", "roll"]) == (cd, ())
    with pytest.raises(BaseError, match="TPP is fitted on roll,pitch, not on roll; --model cd can"):
        on_axes(find_base("tpp"), ["roll"])
    with pytest.raises(BaseError, match="ROLL is fitted on roll, not on sideways"):
        on_axes(find_base("roll"), ["sideways"])


def lone(*runs: sysid.Record, base: str = "cd") -> str | None:
    bare = compose(base)
    return excited_alone(bare, prepared(runs, BAND_HZ).viewed(bare.inputs, bare.outputs).spectra)


def test_one_axis_is_fitted_alone_only_where_one_alone_was_excited() -> None:
    still, busy = flown("roll", 8), flown("roll", 9, other=0.003)
    assert lone(still) == "roll"
    assert lone(flown("pitch", 10), base="multirotor") == "pitch"
    assert lone(still, flown("pitch", 11)) is None
    assert lone(busy) is None, "the other command moves: on what is no multirotor that may be its excitation"
    assert lone(flown("roll", 9, other=0.003, airframe=Airframe.MULTIROTOR)) == "roll"
    assert lone(flown("roll", 8, coupled=0.5)) is None, "the other rate answers: the axes are coupled"
    assert lone(still, base="tpp") is None


def test_where_the_other_axis_is_refused_the_way_to_fit_one_is_told() -> None:
    with pytest.raises(FitError, match="fly a pitch chirp and add its run, or fit roll alone: --axes roll"):
        sysid.fit_model([flown("roll", 12)], "cd", band_hz=BAND_HZ)
    with pytest.raises(FitError, match=r"fly a pitch chirp and add its run$"):
        sysid.fit_model([flown("roll", 12)], "tpp", band_hz=BAND_HZ)
