"""Flights with a planted effect, made without the package: the truth that identification is judged by.

Nothing of sysid, sitl or gcs is imported: the vehicle (the paper's Tables 4 and 5), every effect of the catalogue, the
chirps, the controller and the gusts are written out here a second time, from the equations, so that a slip in one place
is not repeated in the other. Integration is Runge-Kutta of fourth order with two steps or more in each 2-ms sample.

Conventions. Body axes and signs as everywhere: p right side down, q nose up. A command sample acts from its time until
the next; a rate sample is the value at its time. Gusts are angular accelerations, held over a sample. The controller
sees the measured rates, noise included, and the true attitude. A constant trim is in all commands.
Logged without error: commands, excitation, omega, airspeed, r, attitude, vanes.

Flights of several seeds are integrated side by side (a column a run), and cost hardly more than one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

Array = NDArray[np.float64]
Run = dict[str, Array]

DT = 0.002
STEPS = 2
"""Runge-Kutta's, in each sample; twice as many where the rates are linear, which costs nothing."""
G = 9.80665
REST_S = 1.0
"""Without excitation, before and after each maneuver."""

TABLE_4 = MappingProxyType(
    {
        "L_b": 147.548, "M_a": 713.378, "tau_f": 0.091, "A_b": -1.338, "B_a": 1.448,
        "A_lat": -0.282, "A_lon": 0.296, "B_lat": 0.524, "B_lon": -0.050,
    }
)  # fmt: skip
TABLE_5 = MappingProxyType(
    {
        "L_b": 147.550, "M_a": 713.380, "tau_f": 0.075, "A_b": -0.908, "B_a": 0.999,
        "A_lat": -0.196, "A_lon": 0.214, "B_lat": 0.440, "B_lon": -0.026,
        "L_p": -0.930, "M_q": 4.691, "M_elev": 37.752,
    }
)  # fmt: skip

NOMINAL_OMEGA = 1650 * 2 * math.pi / 60
ROTOR_RPM = (1550.0, 1720.0)
AIRSPEED = (17.0, 19.5)
TRIM = (0.02, -0.03, 0.0)
"""delta_x, delta_y, delta_e of straight flight."""
GUST = (0.16, 0.7)
"""Standard deviation in rad/s^2, about as the inverse inertias."""
GUST_HZ = 1.5
COLLECTIVE = 0.05
"""Standard deviation of the pilot's, about a hover's 0.2."""

SIZES = MappingProxyType({"roll": 0.10, "pitch": 0.15, "elevator": 0.30})
"""Chirp amplitudes, of full command."""

RATE_GAIN = np.array([[0.015, 0.0], [0.060, 0.070]])
ATTITUDE_GAIN = np.array([[0.246, -0.056], [0.317, 0.437]])
"""delta_x, delta_y per rad/s and rad of roll and pitch; all modes of both tables stay damped with 0 to 40 ms of lag."""

PLANTED: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        # rotor. These are what tau_f, A_b and B_a of Table 4 imply; the four input terms stay Table 4's.
        "second_order_flapping": {"lock_number": 1.018, "flap_frequency_ratio": 1.085},
        "dynamic_inflow": {"k_l": 0.3, "tau_l": 0.015},
        "rotor_speed": {"k": 1.0, "n": 0.5},
        # A motor and hub of 0.002 kg m^2 at 1650 RPM over 0.641 and 0.133 kg m^2.
        "hub_gyroscopics": {"h_p": 0.54, "h_q": 2.6},
        "disc_incidence": {"A_alpha": 0.2, "B_alpha": 0.1},
        # fuselage
        "angular_damping": {"L_p": -0.5, "M_q": -2.0},
        "quadratic_damping": {"L_pp": -3.0, "M_qq": -6.0, "exponent": 2.0},
        "attitude_stiffness": {"L_phi": -8.0, "M_theta": -20.0},
        "speed_stability": {"Y_v": -0.3, "L_v": -2.0, "X_u": -0.3, "M_u": 6.0},
        "inertia_coupling": {"c_p": 0.05},
        "yaw_coupling": {"k_p": -0.9, "k_q": 0.9},
        "structural_mode": {
            "frequency_roll": 7.0, "zeta_roll": 0.03, "kappa_roll": 0.2,
            "frequency_pitch": 9.0, "zeta_pitch": 0.04, "kappa_pitch": 0.25,
        },
        "input_coupling": {"L_delta_c": -2.0, "M_delta_c": 8.0, "L_delta_r": 1.0, "M_delta_r": -3.0},
        # forward flight
        "elevator": {"M_elev": 37.752},
        "angle_of_attack": {"Z_a": 2.0, "M_alpha": -25.0},
        "sideslip": {"Y_b": 0.8, "L_beta": -8.0},
        "airspeed_scaling": {"m": 1.0},
        # actuators
        "servo_lag": {"tau_s": 0.03},
        "lag_per_axis": {"tau_x": 0.01, "tau_y": 0.03},
        "servo_second_order": {"frequency": 12.0, "zeta": 0.7},
        "transport_delay": {"T_d": 0.0131},
        "servo_rate_limit": {"rate": 4.0},
        "servo_acceleration_limit": {"acceleration": 100.0},
        "servo_saturation": {"limit": 0.12},
        "servo_deadband": {"width": 0.01},
        "servo_backlash": {"half_width": 0.012},
        # sensors
        "gyro_lag": {"tau_g": 0.008},
        "gyro_misalignment": {"e": 0.1},
        "gyro_filter": {"corner": 20.0, "zeta": 0.707},
        # what Mettler's model of a small helicopter has, its bar steered a little
        "stabiliser_bar": {"k_b": 0.3, "d_b": 0.15, "tau_b": 0.36},
        "lead_lag": {"frequency_lag": 7.0, "zeta_lag": 0.05, "gain": 0.15},
        "slipstream_wing": {"L_w": 0.0, "M_w": 120.0, "tau_w": 0.12},
        "governor": {"k_g": 0.5, "tau_o": 0.4},
        # its sign and size are a reading of the cyclic's four terms: nothing else of the base changes
        "swashplate_phase": {"psi": 0.2},
    }
)  # fmt: skip
"""Effect -> sizes that a user would meet, in SI and Hz, under the catalogue's names. `flapping` is the base itself
and is not here."""

VANE_Z_A = 4.0
"""1/s, Z_a of the angle of attack that `disc_incidence` reads from a vane."""

FORWARD = frozenset({"disc_incidence", "elevator", "angle_of_attack", "sideslip", "airspeed_scaling"})
"""To be flown with `forward=True`; the others belong to both."""

NULLS: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "dynamic_inflow": {"k_l": 0.0, "tau_l": 0.02},
        "rotor_speed": {"k": 0.0, "n": 0.0},
        "hub_gyroscopics": {"h_p": 0.0, "h_q": 0.0},
        "disc_incidence": {"A_alpha": 0.0, "B_alpha": 0.0},
        "angular_damping": {"L_p": 0.0, "M_q": 0.0},
        "quadratic_damping": {"L_pp": 0.0, "M_qq": 0.0, "exponent": 2.0},
        "attitude_stiffness": {"L_phi": 0.0, "M_theta": 0.0},
        "speed_stability": {"Y_v": -0.3, "L_v": 0.0, "X_u": -0.3, "M_u": 0.0},
        "inertia_coupling": {"c_p": 0.0},
        "structural_mode": {
            "frequency_roll": 8.0, "zeta_roll": 0.1, "kappa_roll": 0.0,
            "frequency_pitch": 9.0, "zeta_pitch": 0.1, "kappa_pitch": 0.0,
        },
        "input_coupling": {"L_delta_c": 0.0, "M_delta_c": 0.0, "L_delta_r": 0.0, "M_delta_r": 0.0},
        "elevator": {"M_elev": 0.0},
        "angle_of_attack": {"Z_a": 2.0, "M_alpha": 0.0},
        "sideslip": {"Y_b": 0.8, "L_beta": 0.0},
        "airspeed_scaling": {"m": 0.0},
        "transport_delay": {"T_d": 0.0},
        "servo_rate_limit": {"rate": math.inf},
        "servo_acceleration_limit": {"acceleration": math.inf},
        "servo_saturation": {"limit": math.inf},
        "servo_deadband": {"width": 0.0},
        "servo_backlash": {"half_width": 0.0},
        "gyro_misalignment": {"e": 0.0},
        "stabiliser_bar": {"k_b": 0.0, "d_b": 0.0, "tau_b": 0.36},
        "lead_lag": {"frequency_lag": 7.0, "zeta_lag": 0.05, "gain": 0.0},
        "slipstream_wing": {"L_w": 0.0, "M_w": 0.0, "tau_w": 0.12},
        "governor": {"k_g": 0.0, "tau_o": 0.4},
        "swashplate_phase": {"psi": 0.0},
    }
)  # fmt: skip
"""Effect -> sizes at which there is none. Lags have theirs at a time constant of zero, which no integrator can take;
`yaw_coupling` keeps the tip-path plane's own share when k_p and k_q vanish."""


# ------------------------------------------------------------------------------------------ what is put in


def chirp(size: float, duration_s: float) -> Array:
    """Table 1: omega_0 + C2 (exp(C1 t/T) - 1)(omega_1 - omega_0) from 0.5 to 10 Hz, C1 = 4, as the sine of its sum."""
    t = np.arange(round(duration_s / DT)) * DT
    low, high, c1 = 2 * np.pi * 0.5, 2 * np.pi * 10.0, 4.0
    share = (duration_s / c1 * np.expm1(c1 * t / duration_s) - t) / math.expm1(c1)
    return np.asarray(size * np.sin(low * t + (high - low) * share))


def _coloured(rng: np.random.Generator, deviation: float, corner_hz: float, n: int) -> Array:
    """First-order filtered noise of that standard deviation, stationary from the first sample on."""
    pole = math.exp(-2 * math.pi * corner_hz * DT)
    white = rng.standard_normal(n) * math.sqrt(1 - pole * pole)
    white[0] = rng.standard_normal()
    return np.asarray(deviation * lfilter([1.0], [1.0, -pole], white))


def _wander(rng: np.random.Generator, low: float, high: float, t: Array) -> Array:
    """Between two bounds, two slow sines."""
    first, second = rng.uniform(0, 2 * math.pi, 2)
    wave = 0.6 * np.sin(2 * np.pi * 0.035 * t + first) + 0.4 * np.sin(2 * np.pi * 0.09 * t + second)
    return np.asarray(0.5 * (low + high) + 0.5 * (high - low) * wave)


def axes(forward: bool) -> tuple[str, ...]:
    """The excited axes, in the order in which `fly` returns its runs."""
    return ("roll", "pitch", "elevator", "roll", "pitch", "elevator") if forward else ("roll", "pitch") * 2


@dataclass
class _Air:
    """Everything that does not depend on the vehicle's answer; arrays (samples, ..., runs)."""

    excitation: Array
    """(n, 3, runs): x, y, e."""
    gust: Array
    """(n, 2, runs): on p_dot and q_dot."""
    noise: Array
    """(n, 2, runs): on the measured p and q."""
    gust_alpha: Array
    """(n, runs): vertical gusts, rad/s."""
    r: Array
    omega: Array
    airspeed: Array
    delta_c: Array
    delta_r: Array


def _air_of_run(axis: str, seed: Sequence[int], duration_s: float, gusts: float, noise: float) -> list[Array]:
    rng = np.random.default_rng(seed)
    n, rest = round((duration_s + 2 * REST_S) / DT), round(REST_S / DT)
    t = np.arange(n) * DT
    during = slice(rest, rest + round(duration_s / DT))
    excitation = np.zeros((n, 3))
    corner = 2 * math.pi * 10.0 * DT
    alpha = corner / (1 + corner)
    white = rng.normal(0.0, 0.2 * SIZES[axis], (excitation[during].shape[0], 3))
    excitation[during] = lfilter([alpha], [1.0, alpha - 1.0], white, axis=0)
    excitation[during, ("roll", "pitch", "elevator").index(axis)] += chirp(SIZES[axis], duration_s)
    gust = np.stack([gusts * _coloured(rng, size, GUST_HZ, n) for size in GUST], axis=1)
    return [
        excitation,
        gust,
        noise * rng.standard_normal((n, 2)),
        gusts * _coloured(rng, 0.08, 1.0, n),
        _coloured(rng, 0.6, 0.5, n),  # turning about the shaft by hand
        _wander(rng, *ROTOR_RPM, t) * 2 * np.pi / 60,
        _wander(rng, *AIRSPEED, t),
        0.2 + _coloured(rng, COLLECTIVE, 1.0, n),
        _coloured(rng, 0.1, 2.0, n),
    ]


# ------------------------------------------------------------------------------------------ the equations


@dataclass
class _Equations:
    """x' = A x + B u + gusts + extra, as rows of names; and what lies before and behind it."""

    rows: dict[str, dict[str, float]]
    """State -> what its rate is made of: state, input or gust -> coefficient."""
    measured: dict[str, dict[str, float]] = field(
        default_factory=lambda: {"p": {"p": 1.0}, "q": {"q": 1.0}},
    )
    """What the gyro shows of p and q, before its noise."""
    varying: Callable[[Mapping[str, Array], Mapping[str, Array]], Mapping[tuple[str, str], Array]] | None = None
    """(signals, their flights' means) -> (state, state or signal) -> what is added to that coefficient in this sample,
    (runs,)."""
    nonlinear: Callable[[Mapping[str, Array]], Mapping[str, Array]] | None = None
    """States -> what is added to rates."""

    def add(self, state: str, **coefficients: float) -> None:
        row = self.rows.setdefault(state, {})
        for name, value in coefficients.items():
            row[name] = row.get(name, 0.0) + value


SIGNALS = ("x", "y", "e", "c", "r_command", "gust_p", "gust_q", "gust_alpha", "r", "omega", "airspeed")
"""Acting commands (x, y, e: less their trim), gusts and what else equations may read, in the order of the columns."""


def add_servo(E: _Equations, effect: str, size: Mapping[str, float], name: str) -> None:
    """The position v_<name> of a servo of one lag, or of two poles, that follows this command."""
    if effect == "servo_lag":
        E.add(f"v_{name}", **{name: 1 / size["tau_s"], f"v_{name}": -1 / size["tau_s"]})
        return
    w, zeta = 2 * math.pi * size["frequency"], size["zeta"]
    E.add(f"v_{name}", **{f"w_{name}": 1.0})
    E.add(f"w_{name}", **{name: w * w, f"v_{name}": -w * w, f"w_{name}": -2 * zeta * w})


def equations(
    effect: str | None, size: Mapping[str, float], forward: bool, table: Mapping[str, float] | None = None
) -> _Equations:
    """The base with one effect; `table` is a vehicle's own in place of the paper's, `omega` its rotor's speed. Raises
    KeyError for an effect or a size that does not exist."""
    if effect is not None and set(size) != set(PLANTED[effect]):
        raise KeyError(f"{effect} takes {', '.join(PLANTED[effect])}")
    N = dict(table or (TABLE_5 if forward else TABLE_4))
    N.setdefault("L_p", 0.0)
    N.setdefault("M_q", 0.0)
    N.setdefault("M_elev", 0.0)
    if effect in ("angular_damping", "elevator"):
        N.update({name: size[name] for name in PLANTED[effect]})
    tau, L_b, M_a = N["tau_f"], N["L_b"], N["M_a"]
    # the cyclic that acts: the command, or what the servo makes of it
    x, y, e = ("v_x", "v_y", "v_e") if effect in ("servo_lag", "servo_second_order") else ("x", "y", "e")
    x, y = ("v_x", "v_y") if effect == "lag_per_axis" else (x, y)

    E = _Equations({})
    E.add("p", b=L_b, p=N["L_p"], gust_p=1.0)
    E.add("q", a=M_a, q=N["M_q"], gust_q=1.0)
    E.add("q", **{e: N["M_elev"]})
    E.add("a", q=-1.0, a=-1 / tau, b=N["A_b"] / tau)
    E.add("b", p=-1.0, b=-1 / tau, a=N["B_a"] / tau)
    E.add("a", **{x: N["A_lat"] / tau, y: N["A_lon"] / tau})
    E.add("b", **{x: N["B_lat"] / tau, y: N["B_lon"] / tau})
    E.add("phi", p=1.0)
    E.add("theta", q=1.0)

    match effect:
        case "second_order_flapping":
            _second_order_flapping(E, size, N)
        case "dynamic_inflow":
            # tau_l l_s' = -l_s + k_l (theta_s - a), a_dot += -l_s/tau_f; the same with l_c, theta_c, b
            k_l, tau_l = size["k_l"], size["tau_l"]
            E.add("l_s", l_s=-1 / tau_l, a=-k_l / tau_l, x=k_l * N["A_lat"] / tau_l, y=k_l * N["A_lon"] / tau_l)
            E.add("l_c", l_c=-1 / tau_l, b=-k_l / tau_l, x=k_l * N["B_lat"] / tau_l, y=k_l * N["B_lon"] / tau_l)
            E.add("a", l_s=-1 / tau)
            E.add("b", l_c=-1 / tau)
        case "rotor_speed":
            k, n = size["k"], size["n"]

            def faster(u: Mapping[str, Array], mean: Mapping[str, Array]) -> dict[tuple[str, str], Array]:
                # tau_f as ratio^-k, A_b and B_a as ratio^-2k: A_b/tau_f as ratio^-k
                ratio = u["omega"] / mean["omega"]
                rate, coupling, offset = (ratio**k - 1) / tau, (ratio**-k - 1) / tau, ratio**n - 1
                return {
                    ("p", "b"): offset * L_b,
                    ("q", "a"): offset * M_a,
                    ("a", "a"): -rate,
                    ("b", "b"): -rate,
                    ("a", "b"): coupling * N["A_b"],
                    ("b", "a"): coupling * N["B_a"],
                    ("a", "x"): rate * N["A_lat"],
                    ("a", "y"): rate * N["A_lon"],
                    ("b", "x"): rate * N["B_lat"],
                    ("b", "y"): rate * N["B_lon"],
                }

            E.varying = faster
        case "governor":
            E.varying = lambda u, mean: _faster(u["omega"] / NOMINAL_OMEGA, N)
        case "stabiliser_bar":
            # Mettler's c and d: what reaches the rotor is the cyclic and K times the bar; here K = k_b, C = d_b/k_b
            k_b, d_b, tau_b = (size[name] for name in ("k_b", "d_b", "tau_b"))
            E.add("bar_c", bar_c=-1 / tau_b, q=-1.0, y=d_b / (k_b or 1.0) / tau_b)
            E.add("bar_d", bar_d=-1 / tau_b, p=-1.0, x=d_b / (k_b or 1.0) / tau_b)
            E.add("a", bar_c=k_b * N["A_lon"] / tau, bar_d=k_b * N["A_lat"] / tau)
            E.add("b", bar_c=k_b * N["B_lon"] / tau, bar_d=k_b * N["B_lat"] / tau)
        case "lead_lag":
            w, zeta, gain = 2 * math.pi * size["frequency_lag"], size["zeta_lag"], size["gain"]
            for axis, tilt, moment in (("p", "b", L_b), ("q", "a", M_a)):
                E.add(f"g_{tilt}", **{f"h_{tilt}": 1.0})
                E.add(f"h_{tilt}", **{tilt: w * w, f"g_{tilt}": -w * w, f"h_{tilt}": -2 * zeta * w})
                E.add(axis, **{tilt: -gain * moment, f"g_{tilt}": gain * moment})
        case "slipstream_wing":
            # the wake's direction in space, W = (tilt + attitude)/(1 + tau_w s); the wing feels it against the body
            tau_w = size["tau_w"]
            for axis, tilt, angle, moment in (("p", "b", "phi", "L_w"), ("q", "a", "theta", "M_w")):
                E.add(f"W_{tilt}", **{tilt: 1 / tau_w, angle: 1 / tau_w, f"W_{tilt}": -1 / tau_w})
                E.add(axis, **{f"W_{tilt}": size[moment], angle: -size[moment]})
        case "swashplate_phase":
            cosine, sine = math.cos(size["psi"]), math.sin(size["psi"])
            for tilt, lat, lon in (("a", N["A_lat"], N["A_lon"]), ("b", N["B_lat"], N["B_lon"])):
                E.add(tilt, x=(lat * cosine + lon * sine - lat) / tau, y=(lon * cosine - lat * sine - lon) / tau)
        case "hub_gyroscopics":
            E.add("p", q=-size["h_p"])
            E.add("q", p=size["h_q"])
        case "disc_incidence":
            # alpha as a vane shows it, moved by pitching and by vertical gusts
            E.add("alpha", q=1.0, alpha=-VANE_Z_A, gust_alpha=1.0)
            E.add("a", alpha=size["A_alpha"] / tau)
            E.add("b", alpha=size["B_alpha"] / tau)
        case "quadratic_damping":
            E.nonlinear = lambda s: {
                "p": size["L_pp"] * s["p"] * np.abs(s["p"]) ** (size["exponent"] - 1),
                "q": size["M_qq"] * s["q"] * np.abs(s["q"]) ** (size["exponent"] - 1),
            }
        case "attitude_stiffness":
            E.add("p", phi=size["L_phi"])
            E.add("q", theta=size["M_theta"])
        case "speed_stability":
            E.add("v", phi=G, b=G, v=size["Y_v"])
            E.add("p", v=size["L_v"])
            E.add("u", theta=-G, a=-G, u=size["X_u"])
            E.add("q", u=size["M_u"])
        case "inertia_coupling":
            # the moments are all of what stands in the rows, gusts included
            c_p = size["c_p"]
            c_q = c_p * M_a / L_b
            N_p, N_q = E.rows.pop("p"), E.rows.pop("q")
            for name in {**N_p, **N_q}:
                both = 1 - c_p * c_q
                E.add("p", **{name: (N_p.get(name, 0.0) + c_p * N_q.get(name, 0.0)) / both})
                E.add("q", **{name: (N_q.get(name, 0.0) + c_q * N_p.get(name, 0.0)) / both})
        case "yaw_coupling":
            E.varying = lambda u, mean: {
                ("p", "q"): size["k_p"] * u["r"],
                ("q", "p"): size["k_q"] * u["r"],
                ("a", "b"): -u["r"],
                ("b", "a"): u["r"],
            }
        case "structural_mode":
            for axis, word in (("p", "roll"), ("q", "pitch")):
                w, zeta, kappa = (size[f"{name}_{word}"] for name in ("frequency", "zeta", "kappa"))
                w *= 2 * math.pi
                E.add(axis, **{f"e_{axis}": kappa * w * w, f"f_{axis}": 2 * kappa * zeta * w})
                # f = e'; its rate holds the whole of p_dot, the mode's own part included
                E.add(f"e_{axis}", **{f"f_{axis}": 1.0})
                E.add(f"f_{axis}", **{name: -value for name, value in E.rows[axis].items()})
                E.add(f"f_{axis}", **{f"e_{axis}": -w * w, f"f_{axis}": -2 * zeta * w})
        case "input_coupling":
            E.add("p", c=size["L_delta_c"], r_command=size["L_delta_r"])
            E.add("q", c=size["M_delta_c"], r_command=size["M_delta_r"])
        case "angle_of_attack":
            E.add("alpha", q=1.0, alpha=-size["Z_a"])
            E.add("q", alpha=size["M_alpha"])
        case "sideslip":
            E.add("beta", p=1.0, beta=-size["Y_b"])
            E.add("p", beta=size["L_beta"])
        case "airspeed_scaling":
            m = size["m"]

            def denser(u: Mapping[str, Array], mean: Mapping[str, Array]) -> dict[tuple[str, str], Array]:
                ratio = u["airspeed"] / mean["airspeed"]
                return {
                    ("p", "p"): (ratio**m - 1) * N["L_p"],
                    ("q", "q"): (ratio**m - 1) * N["M_q"],
                    ("q", "e"): (ratio ** (2 * m) - 1) * N["M_elev"],
                }

            E.varying = denser
        case "servo_lag" | "servo_second_order":
            for name in ("x", "y", "e"):
                add_servo(E, effect, size, name)
        case "lag_per_axis":
            for name in ("x", "y"):
                E.add(f"v_{name}", **{name: 1 / size[f"tau_{name}"], f"v_{name}": -1 / size[f"tau_{name}"]})
        case "gyro_lag":
            for axis in ("p", "q"):
                E.add(f"y_{axis}", **{axis: 1 / size["tau_g"], f"y_{axis}": -1 / size["tau_g"]})
                E.measured[axis] = {f"y_{axis}": 1.0}
        case "gyro_filter":
            w, zeta = 2 * math.pi * size["corner"], size["zeta"]
            for axis in ("p", "q"):
                E.add(f"y_{axis}", **{f"z_{axis}": 1.0})
                E.add(f"z_{axis}", **{axis: w * w, f"y_{axis}": -w * w, f"z_{axis}": -2 * zeta * w})
                E.measured[axis] = {f"y_{axis}": 1.0}
        case "gyro_misalignment":
            E.measured = {"p": {"p": 1.0, "q": size["e"]}, "q": {"q": 1.0, "p": -size["e"]}}
    return E


def _faster(ratio: Array, N: Mapping[str, float]) -> dict[tuple[str, str], Array]:
    """The rotor's rows at so many times its speed: tau_f as ratio^-1, A_b and B_a as ratio^-2."""
    tau = N["tau_f"]
    rate, coupling = (ratio - 1) / tau, (1 / ratio - 1) / tau
    own = {("a", "a"): -rate, ("b", "b"): -rate, ("a", "b"): coupling * N["A_b"], ("b", "a"): coupling * N["B_a"]}
    cyclic = (("a", "x", "A_lat"), ("a", "y", "A_lon"), ("b", "x", "B_lat"), ("b", "y", "B_lon"))
    return own | {(tilt, command): rate * N[name] for tilt, command, name in cyclic}


def _governed(size: Mapping[str, float], collective: Array) -> Array:
    """Rotor speed that collective (n, runs), held over each sample, pulls down; in the middle of each sample."""
    left = math.exp(-DT / size["tau_o"])
    pulled = lfilter([0.0, 1 - left], [1.0, -left], collective - collective.mean(axis=0), axis=0)
    middle = math.exp(-0.5 * DT / size["tau_o"])
    moved = middle * pulled + (1 - middle) * (collective - collective.mean(axis=0))
    return np.asarray(NOMINAL_OMEGA * (1 - size["k_g"] * moved))


def _second_order_flapping(E: _Equations, size: Mapping[str, float], N: Mapping[str, float]) -> None:
    """The disc's two tilts with their inertia, as a root spring and a central hinge give them (Bramwell).

    In the rotor's own time, with g = Lock number/8, s = (flap frequency ratio)^2 - 1, and the disc's rates in space
    a' + q, b' + p:

        (a' + q)' + g (a' + q) - 2 (b' + p) + s a - g b = -g theta_c
        (b' + p)' + g (b' + p) + 2 (a' + q) + s b + g a =  g theta_s

    Without the first two terms of each these are the first-order rows, tau_f = 16/(Lock number Omega),
    A_b = -B_a = -(8/Lock number) s. With them, aa = a' + q and bb = b' + p are the states beside a and b.
    """
    w = N.get("omega", NOMINAL_OMEGA)
    g, s = size["lock_number"] / 8, size["flap_frequency_ratio"] ** 2 - 1
    del E.rows["a"], E.rows["b"]
    E.add("a", aa=1.0, q=-1.0)
    E.add("b", bb=1.0, p=-1.0)
    E.add("aa", aa=-g * w, bb=2 * w, a=-s * w * w, b=g * w * w)
    E.add("aa", x=-g * w * w * N["B_lat"], y=-g * w * w * N["B_lon"])
    E.add("bb", bb=-g * w, aa=-2 * w, b=-s * w * w, a=-g * w * w)
    E.add("bb", x=g * w * w * N["A_lat"], y=g * w * w * N["A_lon"])


# ------------------------------------------------------------------------------------------ actuators that no row says


ACTUATOR_EFFECTS = (
    "servo_saturation", "servo_deadband", "servo_backlash", "transport_delay", "servo_rate_limit",
    "servo_acceleration_limit",
)  # fmt: skip
BRAKING_STEPS = 16
"""Of a servo that brakes, in one step of the vehicle."""


class _Actuators:
    """From command samples (3, runs) to what acts, for the effects that are about single commands."""

    def __init__(self, effect: str | None, size: Mapping[str, float], start: Array, dt: float = DT) -> None:
        self._effect = effect
        self._size = size
        self._held = start
        self._dt = dt
        self._recent = [start] * (2 + int(size["T_d"] / dt)) if effect == "transport_delay" else []

    @property
    def pass_on(self) -> bool:
        """Whether commands act as they are."""
        return self._effect not in ACTUATOR_EFFECTS

    def pieces(self, command: Array, steps: int) -> list[tuple[float, Array]]:
        """(length in s, acting command), adding up to one sample."""
        h = self._dt / steps
        match self._effect:
            case "servo_saturation":
                limit = self._size["limit"]
                # the swashplate's tilt ends on a ring, the elevator at two stops
                inside = np.minimum(1.0, limit / np.maximum(np.hypot(command[0], command[1]), 1e-12))
                command = np.stack([command[0] * inside, command[1] * inside, np.clip(command[2], -limit, limit)])
            case "servo_deadband":
                command = np.where(np.abs(command - self._held) <= self._size["width"], self._held, command)
                self._held = command
            case "servo_backlash":
                half = self._size["half_width"]
                command = np.minimum(np.maximum(self._held, command - half), command + half)  # `clip` takes longer
                self._held = command
            case "transport_delay":
                return self._delayed(command, steps)
            case "servo_rate_limit":
                return [(h, self._slewed(command, h)) for _ in range(steps)]
            case "servo_acceleration_limit" if math.isfinite(self._size["acceleration"]):
                return [(h, self._braked(command, h)) for _ in range(steps)]
        return [(h, command)] * steps

    def _delayed(self, command: Array, steps: int) -> list[tuple[float, Array]]:
        """The delayed command jumps inside a sample: a step ends there."""
        self._recent = [*self._recent[1:], command]
        dt = self._dt
        whole, rest = divmod(self._size["T_d"], dt)
        if rest > dt * (1 - 1e-9):
            whole, rest = whole + 1, 0.0
        new = self._recent[-1 - int(whole)]
        if rest < dt * 1e-9:
            return [(dt / steps, new)] * steps
        old, half = self._recent[-2 - int(whole)], max(1, steps // 2)
        return [(rest / half, old)] * half + [((dt - rest) / half, new)] * half

    def _slewed(self, command: Array, h: float) -> Array:
        """The mean over h of a position that runs at the limit until it is there."""
        rate = self._size["rate"]
        way = np.clip(command - self._held, -rate * h, rate * h)
        running_s = np.abs(way) / rate
        mean = self._held + way * (1 - 0.5 * running_s / h)
        self._held = self._held + way
        return np.asarray(mean)

    def _braked(self, command: Array, h: float) -> Array:
        """The mean over h of a position as fast as it can be stopped at the command, in small steps of Heun's."""
        part, mean = h / BRAKING_STEPS, np.zeros_like(command)

        def way(at: Array) -> Array:
            error = command - at
            fast = np.sign(error) * np.sqrt(2 * self._size["acceleration"] * np.abs(error)) * part
            return np.asarray(np.clip(fast, -np.abs(error), np.abs(error)))

        for _ in range(BRAKING_STEPS):
            before, first = self._held, way(self._held)
            self._held = before + 0.5 * (first + way(before + first))
            mean += 0.5 * (before + self._held) / BRAKING_STEPS
        return mean


# ------------------------------------------------------------------------------------------ flying


def _mean(values: Array, flights: int) -> Array:
    """Over all runs of each flight, (runs,): what the effects compare with."""
    n, runs = values.shape
    per_flight = values.reshape(n, flights, runs // flights).mean(axis=(0, 2))
    return np.repeat(per_flight, runs // flights)


def _runge_kutta(A: Array, h: float, times: int = 1) -> tuple[Array, Array]:
    """Two steps of h/2, so many times, where rates are A x + c with both constant: x becomes the first times x plus the
    second times c. What the evaluations of a step sum to, multiplied out; A of shape (..., states, states)."""
    unit, hA = np.eye(A.shape[-1]), 0.5 * h * A
    held = 0.5 * h * (unit + hA @ (unit / 2 + hA @ (unit / 6 + hA / 24)))
    step = unit + held @ A
    steps, helds = step, held
    for _ in range(2 * times - 1):
        steps, helds = step @ steps, step @ helds + held
    return steps, helds


@dataclass
class _Flight:
    """The vehicle in numbers, and what happens to it."""

    E: _Equations
    A: Array
    """(states, states)"""
    B: Array
    """(states, SIGNALS)"""
    feedback: Array
    """(2, states): what the controller makes of them, less the gyro's noise."""
    command: Array
    """(n, 3, runs), without the feedback of the states."""
    outside: Array
    """(n, SIGNALS without x, y, e, runs)"""
    mean: Mapping[str, Array]
    trim: Array
    """(3, runs)"""
    steps: int
    dt: float = DT

    @property
    def states(self) -> tuple[str, ...]:
        return tuple(self.E.rows)

    def added(self, at: int | slice) -> Mapping[tuple[str, str], Array]:
        """To the coefficients, in one sample (runs,) or several (samples, runs)."""
        outside = {name: self.outside[at, i] for i, name in enumerate(SIGNALS[3:])}
        return {} if self.E.varying is None else self.E.varying(outside, self.mean)


BLOCKS = 64
"""Of samples, integrated side by side."""
PART = 4096
"""Samples whose matrices are in memory together."""


def _in_blocks(values: Array, length: int) -> Array:
    """(n, ...) as (length, BLOCKS, ...), with zeros behind the end."""
    filled = np.zeros((BLOCKS * length, *values.shape[1:]))
    filled[: len(values)] = values
    return filled.reshape(BLOCKS, length, *values.shape[1:]).swapaxes(0, 1)


def _march(F: Array, g: Array, start: Array) -> Array:
    """x[0] = start, x[k + 1] = F[k] x[k] + g[k], to x[n]: (n + 1, m, states, columns).

    F (n, m, states, states), g (n, m, states, columns), start (m, states, columns). Blocks of samples are integrated
    side by side from rest, and what each hands on to the next is added afterwards.
    """
    n = len(g)
    length = -(-(n + 1) // BLOCKS)
    F, g = _in_blocks(F, length), _in_blocks(g, length)
    x, grown = np.zeros_like(g), np.zeros_like(F)
    grown[0] = np.eye(F.shape[-1])
    for k in range(1, length):
        x[k] = F[k - 1] @ x[k - 1] + g[k - 1]
        grown[k] = F[k - 1] @ grown[k - 1]
    begin = np.empty_like(x[0])
    for block, (whole, passed) in enumerate(zip(F[-1] @ grown[-1], F[-1] @ x[-1] + g[-1], strict=True)):
        begin[block] = start
        start = whole @ start + passed
    x += grown @ begin
    return x.swapaxes(0, 1).reshape(BLOCKS * length, *x.shape[2:])[: n + 1]


def _matrices(flight: _Flight, part: slice) -> tuple[Array, Array]:
    """A and B of these samples: (1, 1, ...), or (samples, runs, ...) where they vary."""
    added = flight.added(part)
    if not added:
        return flight.A[None, None], flight.B[None, None]
    index = {name: i for i, name in enumerate(flight.states)}
    shape = flight.outside[part, 0].shape
    A, B = (np.tile(matrix, (*shape, 1, 1)) for matrix in (flight.A, flight.B))
    for (row, name), value in added.items():
        if name in index:
            A[..., index[row], index[name]] += value
        else:
            B[..., index[row], SIGNALS.index(name)] += value
    return A, B


def _linear(flight: _Flight) -> tuple[Array, Array]:
    """Commands (n, 3, runs) and states (n, states, runs) where the loop of vehicle and controller is linear."""
    n, _, runs = flight.command.shape
    seen = np.empty((n, len(flight.states), runs))
    apart = flight.E.varying is not None  # every run has its own matrices
    signals = np.concatenate([flight.command - flight.trim, flight.outside], axis=1)
    x = np.zeros((runs, len(flight.states), 1) if apart else (1, len(flight.states), runs))
    for begin in range(0, n, PART):
        part = slice(begin, min(begin + PART, n))
        A, B = _matrices(flight, part)
        step, held = _runge_kutta(A, flight.dt / flight.steps, flight.steps)
        g = held @ (B @ (signals[part].swapaxes(1, 2)[..., None] if apart else signals[part, None]))
        F = step - held @ B[..., :2] @ flight.feedback
        every = _march(np.broadcast_to(F, (len(g), *F.shape[1:])), g, x)
        seen[part] = every[:-1, ..., 0].swapaxes(1, 2) if apart else every[:-1, 0]
        x = every[-1]
    commands = flight.command.copy()
    commands[:, :2] -= flight.feedback @ seen
    return commands, seen


def _sample_by_sample(flight: _Flight, actuators: _Actuators) -> tuple[Array, Array]:
    """The same where it is not: actuators do something to single commands, they end at their stops, or equations are
    not linear."""
    E, B, trim = flight.E, flight.B, flight.trim
    n, _, runs = flight.command.shape
    commands, seen = np.empty_like(flight.command), np.empty((n, len(flight.states), runs))
    X = np.zeros((len(flight.states), runs))
    beside = B[:, 3:] @ flight.outside
    from_commands = B[:, :3].copy()
    known: dict[tuple[float, int], tuple[Array, Array, Array]] = {}

    def of_steps(h: float, times: int) -> tuple[Array, Array, Array]:
        step, held = _runge_kutta(flight.A, h, times)
        return step, held @ from_commands, held @ beside

    for k in range(n):  # `dot`: for small matrices it takes half as long as @
        command = flight.command[k].copy()
        command[:2] -= flight.feedback.dot(X)
        command = np.minimum(np.maximum(command, -1.0), 1.0)
        commands[k], seen[k] = command, X
        pieces = actuators.pieces(command, flight.steps)
        times = len(pieces) if pieces[0] is pieces[-1] else 1
        for h, acting in pieces[::times]:
            moved = acting - trim
            if E.varying is not None:
                X = _varied(flight, k, X, moved, h, times)
            elif E.nonlinear is not None:
                X = _bent(flight, X, from_commands.dot(moved) + beside[k], h, times)
            else:
                step, driven, blown = known.get((h, times)) or known.setdefault((h, times), of_steps(h, times))
                X = step.dot(X) + driven.dot(moved) + blown[k]
    return commands, seen


def integrated(flight: _Flight, actuators: _Actuators) -> tuple[Array, Array]:
    """Commands (n, 3, runs) and states (n, states, runs)."""
    if flight.E.nonlinear is None and actuators.pass_on:
        commands, seen = _linear(flight)
        if not np.any(np.abs(commands) > 1.0):
            return commands, seen
    return _sample_by_sample(flight, actuators)


def _varied(flight: _Flight, k: int, X: Array, moved: Array, h: float, times: int) -> Array:
    """X after steps of h in a sample in which every run has its own matrices."""
    A, B = _matrices(flight, slice(k, k + 1))
    step, held = _runge_kutta(A[0], h, times)
    signals = np.concatenate([moved, flight.outside[k]]).T[..., None]
    return np.asarray((step @ X.T[..., None] + held @ (B[0] @ signals))[..., 0].T)


def _bent(flight: _Flight, X: Array, constant: Array, h: float, times: int) -> Array:
    """X after steps of h of Runge and Kutta where rates are not linear."""
    assert flight.E.nonlinear is not None
    A, nonlinear = flight.A, flight.E.nonlinear
    index = {name: i for i, name in enumerate(flight.states)}

    def rate(state: Array) -> Array:
        out = A.dot(state)
        out += constant
        for name, value in nonlinear(dict(zip(index, state, strict=True))).items():
            out[index[name]] += value
        return np.asarray(out)

    for _ in range(times):
        k1 = rate(X)
        k2 = rate(X + (0.5 * h) * k1)
        k3 = rate(X + (0.5 * h) * k2)
        k4 = rate(X + h * k3)
        X = X + (h / 6) * (k1 + 2 * (k2 + k3) + k4)
    return X


def in_numbers(E: _Equations) -> tuple[Array, Array, Array]:
    """A (states, states), B (states, SIGNALS) and what the gyro shows, C (2, states)."""
    index = {name: i for i, name in enumerate(E.rows)}
    columns = {name: i for i, name in enumerate(SIGNALS)}
    A, B = np.zeros((len(index), len(index))), np.zeros((len(index), len(SIGNALS)))
    for state, row in E.rows.items():
        for name, value in row.items():
            (A if name in index else B)[index[state], index.get(name, columns.get(name, -1))] = value
    C = np.zeros((2, len(index)))
    for i, row in enumerate(E.measured.values()):
        for name, value in row.items():
            C[i, index[name]] = value
    return A, B, C


def _fly(
    effect: str | None,
    size: Mapping[str, float],
    air: _Air,
    forward: bool,
    *,
    flights: int = 1,
    closed: bool = True,
    steps: int = STEPS,
    rpm: float | None = None,
) -> dict[str, Array]:
    """Arrays (n, runs) of everything that happens, for runs of several flights; `closed` False: no controller."""
    E = equations(effect, size, forward)
    index = {name: i for i, name in enumerate(E.rows)}
    runs = air.excitation.shape[2]
    A, B, C = in_numbers(E)

    trim = np.repeat(np.array(TRIM)[:, None], runs, axis=1)
    omega = air.omega
    if effect == "second_order_flapping":
        omega = np.full_like(omega, NOMINAL_OMEGA)
    elif effect == "governor":
        omega = _governed(size, air.delta_c)
    elif rpm is not None:
        omega = np.full_like(omega, rpm * 2 * math.pi / 60)
    mean = {"omega": _mean(omega, flights), "airspeed": _mean(air.airspeed, flights)}
    if rpm is not None:
        mean["omega"] = np.full(runs, NOMINAL_OMEGA)  # the tables' own speed
    outside = np.stack(
        [
            air.delta_c - 0.2, air.delta_r, air.gust[:, 0], air.gust[:, 1], air.gust_alpha, air.r, omega, air.airspeed,
        ],
        axis=1,
    )  # fmt: skip
    feedback, command = np.zeros_like(C), trim + air.excitation
    if closed:
        feedback = RATE_GAIN @ C
        feedback[:, [index["phi"], index["theta"]]] += ATTITUDE_GAIN
        command[:, :2] -= RATE_GAIN @ air.noise
    flight = _Flight(E, A, B, feedback, command, outside, mean, trim, steps, DT)
    commands, seen = integrated(flight, _Actuators(effect, size, trim, DT))
    measured = C @ seen + air.noise
    found = {
        "p": measured[:, 0],
        "q": measured[:, 1],
        "delta_x": commands[:, 0],
        "delta_y": commands[:, 1],
        "delta_e": commands[:, 2],
        "omega": omega,
    }
    found.update({f"state {name}": seen[:, i] for name, i in index.items()})
    return found


def fly_many(
    effect: str | None,
    parameters: Mapping[str, float],
    *,
    seeds: Sequence[int],
    gusts: float = 1.0,
    noise: float = 0.004,
    duration_s: float = 30.0,
    forward: bool = False,
    vanes: bool | None = None,
    steps: int = STEPS,
    rpm: float | None = None,
) -> list[list[Run]]:
    """`fly` for several seeds side by side: a flight is the same whatever flies beside it.

    rpm: a constant rotor speed, at which `rotor_speed` changes the tables' vehicle of 1650 RPM by what it is off.
    """
    flown = axes(forward)
    columns = [_air_of_run(axis, (seed, i), duration_s, gusts, noise) for seed in seeds for i, axis in enumerate(flown)]
    air = _Air(*(np.stack(values, axis=-1) for values in zip(*columns, strict=True)))
    found = _fly(effect, parameters, air, forward, flights=len(seeds), steps=steps, rpm=rpm)
    t = np.arange(air.excitation.shape[0]) * DT
    logged: dict[str, Array] = {
        **{name: found[name] for name in ("p", "q", "delta_x", "delta_y", "delta_e", "omega")},
        **{f"excitation_{letter}": air.excitation[:, i] for i, letter in enumerate("xye")},
        "r": air.r,
        "delta_c": air.delta_c,
        "delta_r": air.delta_r,
        "phi": found["state phi"],
        "theta": found["state theta"],
    }
    if forward:
        logged["airspeed"] = air.airspeed
    if vanes if vanes is not None else effect == "disc_incidence":
        logged.update({name: found[f"state {name}"] for name in ("alpha", "beta") if f"state {name}" in found})
    return [
        [
            {"t": t, **{name: values[:, j].copy() for name, values in logged.items()}}
            for j in range(i * len(flown), (i + 1) * len(flown))
        ]
        for i in range(len(seeds))
    ]


def fly(
    effect: str | None,
    parameters: Mapping[str, float],
    *,
    seed: int,
    gusts: float = 1.0,
    noise: float = 0.004,
    duration_s: float = 30.0,
    forward: bool = False,
    vanes: bool | None = None,
    steps: int = STEPS,
) -> list[Run]:
    """One flight: two roll and two pitch chirps (forward: two elevator chirps more) in the order of `axes(forward)`.

    effect: a key of PLANTED, or None for the base. parameters: its sizes, under PLANTED's names. gusts: times GUST;
    0 switches them off. noise: standard deviation of a gyro sample, rad/s. duration_s: of each chirp; a second of rest
    before and after is kept. vanes: whether alpha and beta are logged where the effect has them (None: only for
    `disc_incidence`, which needs alpha). Returns one dictionary a run, channels of shape (n,) at 500 Hz in the
    contract's names and units; phi and theta are among them and can be dropped by a test that wants them unlogged.
    """
    return fly_many(
        effect,
        parameters,
        seeds=[seed],
        gusts=gusts,
        noise=noise,
        duration_s=duration_s,
        forward=forward,
        vanes=vanes,
        steps=steps,
    )[0]


def respond(
    effect: str | None,
    parameters: Mapping[str, float],
    commands: Array,
    *,
    forward: bool = False,
    steps: int = STEPS,
    **signals: Array,
) -> Run:
    """The bare vehicle's answer from rest to command samples (n, 3) of x, y, e, without controller, gusts or noise.

    signals: r, omega, airspeed, delta_c, delta_r, samples (n,) each; constant where left out. Commands count from the
    trim. Returns measured p, q and every state as `state NAME`, shapes (n,).
    """
    n = commands.shape[0]
    still = np.zeros((n, 1))
    usual = {"r": 0.0, "omega": NOMINAL_OMEGA, "airspeed": 18.0, "delta_c": 0.2, "delta_r": 0.0}
    given = {name: signals[name][:, None] if name in signals else still + value for name, value in usual.items()}
    air = _Air(commands[:, :, None], np.zeros((n, 2, 1)), np.zeros((n, 2, 1)), still, **given)
    found = _fly(effect, parameters, air, forward, closed=False, steps=steps)
    return {name: values[:, 0] for name, values in found.items()}
