"""Draws that are built as the catalogue writes them: the ones that a diagnosis can invert exactly.

Ranges are those of EFFECTS' plausible values, narrowed to what this vehicle (0.64 and 0.13 kg m^2, 1650 RPM, hobby
servos) would have; the comment at each says where they come from. Left out: `flapping`, which is the base itself,
`elevator`, which forward flight always has, and in forward flight `angular_damping`, for the same reason.
"""

from __future__ import annotations

import math

from sitl.hidden.recipe import FORWARD, HOVER, I_X, I_Y, Made, Recipe, Sizes, on_each
from sitl.plants.actuators import Backlash, DeadBand, Lag, Late, Ring, SecondOrderServo
from sitl.plants.fuselages import (
    AngleOfAttack,
    CoupledInertia,
    Drift,
    FlexibleWing,
    ForwardFuselage,
    HubMomentum,
    QuadraticDrag,
    RateDamping,
    Sideslip,
    Tether,
    ThrustLines,
    YawCoupling,
)
from sitl.plants.hover import DT
from sitl.plants.rotorcraft import NOMINAL_AIRSPEED, Parts
from sitl.plants.rotors import Disc, InflowDisc, SecondOrderDisc, powers
from sitl.plants.sensors import RotatedChip, SoftMount

# ------------------------------------------------------------------------------------------------ actuators


def _servo_lag(size: Sizes) -> Made:
    tau_s = size.between(0.012, 0.035)  # hobby servos: 20-50 ms large signal, good digital ones 10-20 ms
    return Made(
        {"tau_s": tau_s},
        on_each(lambda: Lag(tau_s, DT), moves=True),
        f"every servo lags by {1e3 * tau_s:.1f} ms",
    )


def _servo_second_order(size: Sizes) -> Made:
    frequency, zeta = size.at_most(8.0, 18.0), size.fixed(0.5, 0.9)  # small-signal bandwidth of cyclic servos
    return Made(
        {"frequency": frequency, "zeta": zeta},
        on_each(lambda: SecondOrderServo(frequency, min(zeta, 0.95), DT), moves=True),
        f"every servo is a second-order system of {frequency:.1f} Hz and damping ratio {zeta:.2f}",
    )


def _transport_delay(size: Sizes) -> Made:
    T_d = size.between(0.008, 0.025)  # bus, loop and a 50-100 Hz servo frame
    return Made({"T_d": T_d}, on_each(lambda: Late(T_d, DT)), f"commands act {1e3 * T_d:.1f} ms late")


def _servo_rate_limit(size: Sizes) -> Made:
    rate = size.at_most(1.2, 3.5)  # 60 degrees in 0.15-0.5 s over 20 degrees of travel at full cyclic, under load
    return Made(
        {"rate": rate},
        on_each(lambda: Lag(0.0, DT, rate), moves=True),
        f"servos turn at no more than {rate:.2f} of full command per second",
    )


def _servo_saturation(size: Sizes) -> Made:
    limit = size.at_most(0.07, 0.11)  # a cyclic ring set for 1 to 1.5 degrees; less cannot be flown
    return Made(
        {"limit": limit},
        lambda: Parts(actuators=(Ring(limit),)),
        f"the swashplate's tilt ends on a ring at {limit:.3f} of full command",
    )


def _servo_deadband(size: Sizes) -> Made:
    width = size.between(0.012, 0.03)  # 6 to 15 us of 500: digital servos and worn ones
    return Made({"width": width}, on_each(lambda: DeadBand(width)), f"servos ignore changes below {width:.4f}")


def _servo_backlash(size: Sizes) -> Made:
    half_width = size.between(0.007, 0.025)  # 0.1 to 0.3 degree of play each way of 12 degrees
    return Made(
        {"half_width": half_width},
        on_each(lambda: Backlash(half_width)),
        f"the linkages have a play of {half_width:.4f} each way",
    )


# ------------------------------------------------------------------------------------------------ rotor


def _second_order_flapping(size: Sizes) -> Made:
    # Table 4's tau_f and A_b imply 1.018 and 1.085; other blades, from heavy-tipped to ordinary model ones.
    lock_number, ratio = size.fixed(1.5, 2.4), math.sqrt(1 + size.fixed(0.3, 0.45))
    if size.plant == FORWARD:
        ratio = math.sqrt(1 + size.fixed(0.25, 0.35))
    airframe = size.airframe
    return Made(
        {"lock_number": lock_number, "flap_frequency_ratio": ratio},
        lambda: Parts(rotor=SecondOrderDisc(airframe.table, airframe.nominal_rpm, lock_number, ratio)),
        f"the blades flap with their inertia: Lock number {lock_number:.2f}, flap frequency ratio {ratio:.3f}",
    )


def _dynamic_inflow(size: Sizes) -> Made:
    k_l, tau_l = min(0.6, size.between(0.25, 0.5)), size.fixed(0.01, 0.04)  # momentum theory, apparent mass
    airframe = size.airframe
    return Made(
        {"k_l": k_l, "tau_l": tau_l},
        lambda: Parts(rotor=InflowDisc(airframe.table, airframe.nominal_rpm, k_l, tau_l)),
        f"the inflow answers late: gain {k_l:.2f}, time constant {1e3 * tau_l:.0f} ms",
    )


def _rotor_speed(size: Sizes) -> Made:
    k, n = size.between(0.8, 1.2), size.between(0.6, 1.6)  # theory 1; a spring hub 0, an offset hinge up to 2
    airframe = size.airframe
    return Made(
        {"k": k, "n": n},
        lambda: Parts(rotor=Disc(airframe.table, airframe.nominal_rpm, law=powers(k, n))),
        f"the rotor follows its speed: tau_f as Omega^-{k:.2f}, A_b and B_a as Omega^-{2 * k:.2f}, "
        f"L_b and M_a as Omega^{n:.2f}",
    )


def _hub_gyroscopics(size: Sizes) -> Made:
    momentum = size.between(0.25, 0.9)  # kg m^2/s: 0.0015-0.005 kg m^2 of motor bell and hub at 1650 RPM
    sign = size.sign()
    h_p, h_q = sign * momentum / I_X, sign * momentum / I_Y
    return Made(
        {"h_p": h_p, "h_q": h_q},
        lambda: Parts(loads=(HubMomentum(h_p, h_q),)),
        f"motor and hub carry {momentum:.2f} kg m^2/s",
    )


# ------------------------------------------------------------------------------------------------ fuselage


def _angular_damping(size: Sizes) -> Made:
    L_p, M_q = -size.between(0.4, 2.0), -size.between(1.5, 5.0)  # wings and tips in the slipstream
    return Made(
        {"L_p": L_p, "M_q": M_q},
        lambda: Parts(loads=(RateDamping(L_p, M_q),)),
        f"the fuselage is damped: L_p {L_p:.2f}, M_q {M_q:.2f} 1/s",
    )


def _quadratic_damping(size: Sizes) -> Made:
    L_pp, M_qq = -size.between(3.0, 9.0), -size.between(4.0, 9.5)  # plates across the flow; wings edge-on give 0.1
    return Made(
        {"L_pp": L_pp, "M_qq": M_qq},
        lambda: Parts(loads=(QuadraticDrag(L_pp, M_qq),)),
        f"the turning body drags: L_pp {L_pp:.1f}, M_qq {M_qq:.1f}",
    )


def _attitude_stiffness(size: Sizes) -> Made:
    L_phi, M_theta = -size.between(6.0, 25.0), -size.between(15.0, 60.0)  # a test stand's springs
    return Made(
        {"L_phi": L_phi, "M_theta": M_theta},
        lambda: Parts(loads=(Tether(L_phi, M_theta),)),
        f"a moment pulls back to level: L_phi {L_phi:.1f}, M_theta {M_theta:.1f} 1/s^2",
    )


def _speed_stability(size: Sizes) -> Made:
    # Mettler's small helicopters: drag 0.1-0.5 1/s; moments of 1-4 and, about the light axis, 2-8 rad/(m s).
    Y_v, X_u = -size.fixed(0.15, 0.6), -size.fixed(0.15, 0.6)
    L_v, M_u = -size.between(1.0, 3.5), size.between(2.0, 7.0)
    return Made(
        {"Y_v": Y_v, "L_v": L_v, "X_u": X_u, "M_u": M_u},
        lambda: Parts(loads=(Drift(Y_v, L_v, X_u, M_u),)),
        f"drifting turns the vehicle: L_v {L_v:.2f}, M_u {M_u:.2f} rad/(m s)",
    )


def _inertia_coupling(size: Sizes) -> Made:
    c_p = size.sign() * min(0.3, size.between(0.05, 0.16))  # principal axes turned by 4 to 12 degrees
    return Made(
        {"c_p": c_p},
        lambda: Parts(inertia=CoupledInertia(I_X, I_Y, c_p * I_X)),
        f"the body has a product of inertia of {c_p:.3f} times I_xx",
    )


def _yaw_coupling(size: Sizes) -> Made:
    k_p, k_q = -min(1.0, size.between(0.7, 1.0)), min(1.0, size.between(0.7, 1.0))  # a nearly flat body
    airframe = size.airframe
    return Made(
        {"k_p": k_p, "k_q": k_q},
        lambda: Parts(
            rotor=Disc(airframe.table, airframe.nominal_rpm, still=True),
            loads=(YawCoupling(k_p, k_q),),
        ),
        f"yaw couples the axes: k_p {k_p:.2f}, k_q {k_q:.2f}",
    )


def _structural_mode(size: Sizes) -> Made:
    # Wings of 1.5 m in foam and carbon: first bending at 5-10 Hz, 2-6 % damping, a fifth of the inertia in the wing.
    roll = (size.fixed(5.0, 8.0), size.fixed(0.02, 0.06), size.between(0.08, 0.3))
    pitch = (size.fixed(6.5, 10.5), size.fixed(0.02, 0.06), size.between(0.08, 0.3))
    names = ("frequency", "zeta", "kappa")
    sizes = {
        **{f"{name}_roll": value for name, value in zip(names, roll, strict=True)},
        **{f"{name}_pitch": value for name, value in zip(names, pitch, strict=True)},
    }

    def build() -> Parts:
        wing = FlexibleWing(roll, pitch)
        return Parts(loads=(wing,), inertia=wing)

    return Made(
        sizes,
        build,
        f"the airframe bends at {roll[0]:.1f} Hz in roll and {pitch[0]:.1f} Hz in pitch",
    )


def _input_coupling(size: Sizes) -> Made:
    # Rad/s^2 per full command: some 45 N of thrust per full collective, 10 to 50 mm beside the centre of gravity;
    # tip propellers of 2-5 N on arms of half a metre, canted by some degrees.
    collective = (size.sign() * size.between(1.0, 3.5), size.sign() * size.between(3.0, 12.0))
    propellers = (size.sign() * size.between(0.5, 2.0), size.sign() * size.between(1.5, 6.0))
    return Made(
        {
            "L_delta_c": collective[0],
            "M_delta_c": collective[1],
            "L_delta_r": propellers[0],
            "M_delta_r": propellers[1],
        },
        lambda: Parts(loads=(ThrustLines(collective, propellers, None),)),
        f"collective turns the vehicle by {collective[0]:.1f} and {collective[1]:.1f} rad/s^2 per full command, "
        f"the tip propellers by {propellers[0]:.1f} and {propellers[1]:.1f}",
    )


# ------------------------------------------------------------------------------------------------ forward flight


def _angle_of_attack(size: Sizes) -> Made:
    Z_a, M_alpha = size.fixed(1.5, 4.0), -size.between(12.0, 40.0)  # wing loading of 8-15 kg/m^2 at 18 m/s
    return Made(
        {"Z_a": Z_a, "M_alpha": M_alpha},
        lambda: Parts(loads=(AngleOfAttack(Z_a, M_alpha),)),
        f"the angle of attack pitches the vehicle: Z_a {Z_a:.2f} 1/s, M_alpha {M_alpha:.1f} 1/s^2",
    )


def _sideslip(size: Sizes) -> Made:
    Y_b, L_beta = size.fixed(0.4, 1.5), -size.between(4.0, 16.0)  # tip plates and fuselage side
    return Made(
        {"Y_b": Y_b, "L_beta": L_beta},
        lambda: Parts(loads=(Sideslip(Y_b, L_beta),)),
        f"sideslip turns the vehicle into the wind: Y_b {Y_b:.2f} 1/s, L_beta {L_beta:.1f} 1/s^2",
    )


def _airspeed_scaling(size: Sizes) -> Made:
    m = size.between(0.8, 1.2)  # theory 1
    numbers = size.airframe.fuselage
    assert numbers is not None
    return Made(
        {"m": m},
        lambda: Parts(fuselage=ForwardFuselage(*numbers, NOMINAL_AIRSPEED, power=m)),
        f"elevator and damping follow the airspeed: M_elev as V^{2 * m:.2f}, L_p and M_q as V^{m:.2f}",
    )


# ------------------------------------------------------------------------------------------------ sensors


def _gyro_lag(size: Sizes) -> Made:
    tau_g = size.between(0.008, 0.025)  # low-pass filters of 20 down to 6 Hz
    return Made(
        {"tau_g": tau_g},
        lambda: Parts(gyro=(SoftMount(1 / tau_g, None, DT),)),
        f"the gyro's filter lags by {1e3 * tau_g:.1f} ms",
    )


def _gyro_misalignment(size: Sizes) -> Made:
    e = size.sign() * size.between(0.06, 0.22)  # 3 to 12 degrees: an autopilot glued in by eye
    return Made(
        {"e": e},
        lambda: Parts(gyro=(RotatedChip(0.0, 0.0, math.atan(e)),)),
        f"the gyro is turned by {math.degrees(math.atan(e)):.1f} degrees about the shaft",
    )


RECIPES = (
    # An equal lag in all servos and in both gyros is the same: nothing else moves p and q than these commands.
    Recipe(id="servo_lag", answer="servo_lag", make=_servo_lag, accepts=("gyro_lag",)),
    Recipe(id="servo_second_order", answer="servo_second_order", make=_servo_second_order),
    Recipe(id="transport_delay", answer="transport_delay", make=_transport_delay),
    Recipe(id="servo_rate_limit", answer="servo_rate_limit", make=_servo_rate_limit),
    Recipe(id="servo_saturation", answer="servo_saturation", make=_servo_saturation),
    Recipe(id="servo_deadband", answer="servo_deadband", make=_servo_deadband),
    Recipe(id="servo_backlash", answer="servo_backlash", make=_servo_backlash),
    Recipe(id="second_order_flapping", answer="second_order_flapping", make=_second_order_flapping),
    Recipe(id="dynamic_inflow", answer="dynamic_inflow", make=_dynamic_inflow),
    Recipe(id="rotor_speed", answer="rotor_speed", make=_rotor_speed, condition="rpm"),
    Recipe(id="hub_gyroscopics", answer="hub_gyroscopics", make=_hub_gyroscopics),
    Recipe(id="angular_damping", answer="angular_damping", make=_angular_damping, plants=(HOVER,)),
    Recipe(id="quadratic_damping", answer="quadratic_damping", make=_quadratic_damping),
    Recipe(id="attitude_stiffness", answer="attitude_stiffness", make=_attitude_stiffness, plants=(HOVER,)),
    Recipe(id="speed_stability", answer="speed_stability", make=_speed_stability, plants=(HOVER,)),
    Recipe(id="inertia_coupling", answer="inertia_coupling", make=_inertia_coupling),
    Recipe(id="yaw_coupling", answer="yaw_coupling", make=_yaw_coupling, condition="yaw"),
    Recipe(id="structural_mode", answer="structural_mode", make=_structural_mode),
    Recipe(id="input_coupling", answer="input_coupling", make=_input_coupling, condition="stirring"),
    Recipe(id="angle_of_attack", answer="angle_of_attack", make=_angle_of_attack, plants=(FORWARD,)),
    Recipe(id="sideslip", answer="sideslip", make=_sideslip, plants=(FORWARD,)),
    Recipe(
        id="airspeed_scaling",
        answer="airspeed_scaling",
        make=_airspeed_scaling,
        plants=(FORWARD,),
        condition="airspeed",
    ),
    Recipe(id="gyro_lag", answer="gyro_lag", make=_gyro_lag, accepts=("servo_lag",)),
    Recipe(id="gyro_misalignment", answer="gyro_misalignment", make=_gyro_misalignment),
)
