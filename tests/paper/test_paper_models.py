"""The paper's printed numbers, reproduced from its own tables."""

from __future__ import annotations

import numpy as np
import pytest
from planted import TABLE_5

from gcs.analysis.fits import PAPER_PARAMETERS
from sysid.control.observers import with_poles
from sysid.control.regulator import DesignError, design, steady_prefilter
from sysid.model.compose import compose
from sysid.model.paper import CD, TPP, reduce_to_cd
from sysid.model.structure import Model

TABLE_4_TPP = Model(TPP, np.array(PAPER_PARAMETERS["tpp"]))
_FORWARD = compose("tpp", ["angular_damping", "elevator"], ("delta_x", "delta_y", "delta_e"))
TABLE_5_TPP = Model(_FORWARD, _FORWARD.vector(dict(TABLE_5)))
TABLE_4_CD = Model(CD, np.array(PAPER_PARAMETERS["cd"]))


def test_table_2_follows_from_table_4() -> None:
    slow, fast = TABLE_4_TPP.modes
    assert (slow.frequency_hz, slow.damping_ratio) == pytest.approx((1.634, 0.390), abs=5e-4)
    assert (fast.frequency_hz, fast.damping_ratio) == pytest.approx((5.029, 0.221), abs=5e-4)
    (mode,) = TABLE_4_CD.modes
    assert (mode.frequency_hz, mode.damping_ratio) == pytest.approx((1.535, 0.354), abs=5e-4)


def test_reduced_tpp_is_not_the_printed_cd() -> None:
    (mode,) = reduce_to_cd(TABLE_4_TPP).modes
    assert mode.frequency_hz == pytest.approx(2.74, abs=5e-3)
    assert mode.damping_ratio == pytest.approx(0.77, abs=5e-3)


def test_lqr_gain_prefilter_and_poles() -> None:
    gains = design(TABLE_4_TPP)
    expected_K = [[0.2294, -0.2473, -4.610, 3.002], [0.1228, 0.1806, 4.696, -0.364]]
    np.testing.assert_allclose(gains.K, expected_K, rtol=0, atol=5e-4)
    np.testing.assert_allclose(gains.prefilter, [[0.4204, -0.2150], [0.3048, 0.5188]], rtol=0, atol=5e-5)
    upper = sorted((pole for pole in gains.poles if pole.imag > 0), key=lambda pole: pole.imag)
    np.testing.assert_allclose(upper, [-13.48 + 8.79j, -21.04 + 39.00j], rtol=0, atol=6e-3)


def test_observer_poles_are_the_stable_four() -> None:
    gains = design(TABLE_4_TPP)
    np.testing.assert_allclose(sorted(gains.observer_poles.real), [-51, -51, -50, -50], atol=1e-3)
    np.testing.assert_allclose(gains.observer_poles.imag, 0, atol=1e-3)


@pytest.mark.parametrize(("input_cost", "delay_ms"), [(5.0, 48), (2.0, 32)])
def test_delay_margin_of_the_loop_with_observer(input_cost: float, delay_ms: float) -> None:
    assert 1000 * design(TABLE_4_TPP, input_cost).margins.delay_s == pytest.approx(delay_ms, abs=0.5)


def test_delay_margin_against_a_stability_computation_of_its_own() -> None:
    """Padé delays in both commands just inside and outside the margin, poles by eigenvalues."""
    gains = design(TABLE_4_TPP)
    A, B, C, _ = TABLE_4_TPP.matrices

    def stable(delay_s: float) -> bool:
        from control import pade, ss, tf

        numerator, denominator = pade(delay_s, 8)
        late = ss(tf(numerator, denominator))
        plant, n = ss(A, B, C, 0), late.nstates
        zeros = np.zeros((n, n))
        lateA = np.block([[late.A, zeros], [zeros, late.A]])
        lateB = np.kron(np.eye(2), late.B)
        lateC, lateD = np.kron(np.eye(2), late.C), np.kron(np.eye(2), late.D)
        inner = A - gains.observer_gain @ C - B @ gains.K
        top = [plant.A, B @ lateC, -B @ lateD @ gains.K]
        middle = [np.zeros((2 * n, 4)), lateA, -lateB @ gains.K]
        bottom = [gains.observer_gain @ C, np.zeros((4, 2 * n)), inner]
        return bool(np.all(np.linalg.eigvals(np.block([top, middle, bottom])).real < 0))

    margin = gains.margins.delay_s
    assert stable(0.97 * margin)
    assert not stable(1.03 * margin)


def test_prefilter_makes_steady_rates_follow() -> None:
    gains = design(TABLE_4_TPP)
    A, B, C, _ = TABLE_4_TPP.matrices
    steady = C @ np.linalg.solve(-(A - B @ gains.K), B @ gains.prefilter)
    np.testing.assert_allclose(steady, np.eye(2), atol=1e-9)


def test_eq_14_as_printed_is_no_prefilter() -> None:
    """(C(-A + BK)^-1)^-1, without B: 2 rates by 4 states, of which there is no inverse; and its pseudo-inverse, and the
    closest reading with two columns, do not make steady rates follow."""
    gains = design(TABLE_4_TPP)
    A, B, C, _ = TABLE_4_TPP.matrices
    printed = C @ np.linalg.inv(-A + B @ gains.K)
    assert printed.shape == (2, 4)
    with pytest.raises(np.linalg.LinAlgError):
        np.linalg.inv(printed)
    steady = C @ np.linalg.solve(-A + B @ gains.K, B)
    for reading in (np.linalg.pinv(printed)[:2], np.linalg.pinv(printed)[2:]):
        assert not np.allclose(reading, gains.prefilter, atol=0.1)
        assert np.abs(steady @ reading - np.eye(2)).max() > 0.5
    assert steady @ gains.prefilter == pytest.approx(np.eye(2), abs=1e-9)
    assert steady_prefilter(A, B, C, gains.K) == pytest.approx(np.linalg.inv(steady), rel=1e-12)


def test_the_observer_of_the_printed_poles_is_unstable_and_the_meant_one_is_known() -> None:
    """+51 is a slip. With each pole once for every rate there is one L (as eq. 11 writes it)."""
    A, _, C, _ = TABLE_4_TPP.matrices
    gains = design(TABLE_4_TPP)
    expected = [[90.011, 3.2911], [-71.0888, 90.011], [-7.8746, 0.86], [7.9931, 1.7626]]
    np.testing.assert_allclose(gains.observer_gain, expected, rtol=0, atol=6e-4)
    from scipy.signal import place_poles

    printed = place_poles(A.T, C.T, np.array([-50.0, -50.0, -51.0, 51.0])).gain_matrix.T
    assert np.max(np.linalg.eigvals(A - printed @ C).real) == pytest.approx(51.0, rel=1e-6)
    with pytest.raises(DesignError, match="each negative"):
        with_poles(gains, (-50.0, -50.0, -51.0, 51.0), TABLE_4_TPP)


def test_k_is_what_an_independent_riccati_solver_gives() -> None:
    import control

    A, B, _, _ = TABLE_4_TPP.matrices
    K, _, poles = control.lqr(A, B, np.diag([1.0, 1.0, 1e-3, 1e-3]), 5 * np.eye(2))
    gains = design(TABLE_4_TPP)
    np.testing.assert_allclose(gains.K, K, rtol=1e-6)
    np.testing.assert_allclose(np.sort_complex(gains.poles), np.sort_complex(poles), rtol=1e-6)


def test_table_5_has_its_modes_and_three_commands_that_make_steady_rates_follow() -> None:
    """NOTES: forward TPP 1.762 Hz / .454 and 4.622 Hz / .221, CD 1.791 Hz / .428."""
    slow, fast = TABLE_5_TPP.modes
    assert (slow.frequency_hz, slow.damping_ratio) == pytest.approx((1.762, 0.454), abs=1e-3)
    assert (fast.frequency_hz, fast.damping_ratio) == pytest.approx((4.622, 0.221), abs=1e-3)
    import control

    gains = design(TABLE_5_TPP, elevator=True)
    A, B, C, _ = (np.asarray(one, dtype=float) for one in TABLE_5_TPP.matrices)
    assert np.flatnonzero(B[1]).tolist() == [2], "eq. 16: the elevator alone moves q at once"
    K, _, _ = control.lqr(A, B, np.diag([1.0, 1.0, 1e-3, 1e-3]), 5 * np.eye(3))
    np.testing.assert_allclose(gains.K, K, rtol=1e-6, atol=1e-9)
    steady = C @ np.linalg.solve(-(A - B @ gains.K), B)
    np.testing.assert_allclose(steady @ gains.prefilter, np.eye(2), atol=1e-9)
    np.testing.assert_allclose(gains.prefilter, np.linalg.pinv(steady), atol=1e-9)
    assert gains.margins.delay_ms == pytest.approx(40, abs=1)
    assert design(TABLE_5_TPP).K.shape == (2, 4)


def test_margins_of_three_commands_are_those_of_delays_in_all_three() -> None:
    """Just inside and outside by Padé delays of eighth order, with python-control's blocks."""
    from control import pade, ss, tf

    gains = design(TABLE_5_TPP, elevator=True)
    A, B, C, _ = (np.asarray(one, dtype=float) for one in TABLE_5_TPP.matrices)
    inner = A - gains.observer_gain @ C - B @ gains.K
    for factor, stable in ((0.97, True), (1.03, False)):
        late = ss(tf(*pade(factor * gains.margins.delay_s, 8)))
        a, b, c, d = (np.kron(np.eye(3), np.asarray(x)) for x in (late.A, late.B, late.C, late.D))
        whole = np.block(
            [
                [A, B @ c, -B @ d @ gains.K],
                [np.zeros((len(a), 4)), a, -b @ gains.K],
                [gains.observer_gain @ C, np.zeros((4, len(a))), inner],
            ]
        )
        assert bool(np.all(np.linalg.eigvals(whole).real < 0)) is stable


def test_no_gains_on_cd_or_with_a_senseless_weight() -> None:
    with pytest.raises(DesignError, match="--model tpp"):
        design(TABLE_4_CD)
    with pytest.raises(DesignError, match="positive"):
        design(TABLE_4_TPP, 0.0)


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"A_lat": 0.0, "A_lon": 0.0, "B_lat": 0.0, "B_lon": 0.0}, "turn one axis alone, or none"),
        ({"A_lat": 0.524, "A_lon": -0.05}, "turn one axis alone, or none"),
        ({"L_b": float("nan")}, "values that are no numbers: fit again"),
        ({"A_b": float("inf")}, "values that are no numbers: fit again"),
        ({"tau_f": -0.1}, "unstable"),
    ],
)
def test_a_model_that_nothing_holds_is_refused(changed: dict[str, float], says: str) -> None:
    values = dict(zip(TPP.names, PAPER_PARAMETERS["tpp"], strict=True)) | changed
    for elevator in (False, True):
        model = Model(_FORWARD, _FORWARD.vector({**TABLE_5, **values})) if elevator else Model(TPP, TPP.vector(values))
        if elevator and "one axis" in says:
            continue  # the elevator turns the other
        with pytest.raises(DesignError, match=says):
            design(model, elevator=elevator)


def test_a_fit_of_one_axis_alone_has_no_gains_of_two() -> None:
    for outputs in (("p",), ("q",)):
        structure = compose("tpp", outputs=outputs)
        with pytest.raises(DesignError, match=f"this fit has {outputs[0]} alone: fit sweeps of both axes"):
            design(Model(structure, np.array(PAPER_PARAMETERS["tpp"])))


def test_gains_of_a_composition_are_its_tip_path_plane_s_and_the_margins_the_whole_s() -> None:
    """A delay costs itself of the delay margin; a lag less than its time constant, for it takes gain away as well."""
    bare = design(TABLE_4_TPP)
    for effect, value in (("servo_lag", 0.010), ("transport_delay", 0.010)):
        structure = compose("tpp", [effect])
        gains = design(Model(structure, np.append(TABLE_4_TPP.values, value)))
        np.testing.assert_allclose(gains.K, bare.K, rtol=1e-6)
        lost = bare.margins.delay_s - gains.margins.delay_s
        assert lost == pytest.approx(value, rel=0.02) if effect == "transport_delay" else 0 < lost < value
        assert gains.to_json()["margins_with"] == [effect]
