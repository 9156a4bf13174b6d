"""Draws built below the catalogue's level: the cause is simulated, so the answer must be recognised, not inverted.

`expect` says what the catalogue's parameters should come near, where theory gives it.
"""

from __future__ import annotations

import math

from sitl.hidden.recipe import BELOW, FORWARD, HOVER, I_X, I_Y, I_Z, Made, Recipe, Sizes
from sitl.plants.actuators import (
    Backlash,
    Chain,
    DeadBand,
    Each,
    Element,
    Frame,
    Lag,
    Late,
    Mean,
    Ring,
    SecondOrderServo,
    ThreeServos,
)
from sitl.plants.fuselages import AngleOfAttack, Tether, ThrustLines, TurnedInertia, YawCoupling
from sitl.plants.hover import DT
from sitl.plants.rotorcraft import Parts
from sitl.plants.rotors import Disc, ObliqueDisc, PittPetersDisc, spring_and_offset
from sitl.plants.sensors import RotatedChip, SoftMount

# Three servos from one box turn the swashplate; a fourth of the same make moves the elevator.


def _three_slow_servos(size: Sizes) -> Made:
    tau = size.between(0.012, 0.035)
    taus = [size.spread(tau, 0.2) for _ in range(4)]

    def servo(tau: float) -> Element:
        return Mean(Lag(tau, DT))

    return Made(
        {f"tau_{i}": tau for i, tau in enumerate(taus, 1)},
        lambda: Parts(actuators=(ThreeServos([servo(t) for t in taus[:3]], servo(taus[3])),)),
        "three swashplate servos lag by " + ", ".join(f"{1e3 * t:.1f}" for t in taus[:3]) + " ms",
        {"tau_s": sum(taus[:3]) / 3},
    )


def _three_servo_motors(size: Sizes) -> Made:
    """Position loops with inertia."""
    frequency, zeta = size.at_most(8.0, 16.0), size.fixed(0.55, 0.85)
    servos = [(size.spread(frequency, 0.1), size.spread(zeta, 0.1)) for _ in range(4)]

    def servo(one: tuple[float, float]) -> Element:
        return Mean(SecondOrderServo(*one, DT))

    return Made(
        {
            **{f"frequency_{i}": f for i, (f, _) in enumerate(servos, 1)},
            **{f"zeta_{i}": z for i, (_, z) in enumerate(servos, 1)},
        },
        lambda: Parts(actuators=(ThreeServos([servo(s) for s in servos[:3]], servo(servos[3])),)),
        "three swashplate servos have natural frequencies of " + ", ".join(f"{f:.1f}" for f, _ in servos[:3]) + " Hz",
        {"frequency": sum(f for f, _ in servos[:3]) / 3, "zeta": sum(z for _, z in servos[:3]) / 3},
    )


def _servo_frame(size: Sizes) -> Made:
    """Pulses at 50 to 100 Hz, each held until the next, and a bus before them."""
    rate_hz, latency = size.at_most(50.0, 100.0), size.between(0.003, 0.008)
    first_s = size.spread(0.5, 1.0) / rate_hz

    def build() -> Parts:
        # All channels of one receiver bus come in the same frame.
        return Parts(actuators=(Each(lambda: Chain(Late(latency, DT), Frame(1 / rate_hz, DT, first_s)), moves=False),))

    return Made(
        {"frame_hz": rate_hz, "latency_s": latency},
        build,
        f"servos get their pulses at {rate_hz:.0f} Hz, {1e3 * latency:.1f} ms behind the autopilot",
        {"T_d": 0.5 / rate_hz + latency},
    )


def _tired_servos(size: Sizes) -> Made:
    """A weak supply: motors slow, each its own, behind a quick position loop."""
    rate = size.at_most(1.2, 3.0)
    rates = [size.spread(rate, 0.15) for _ in range(4)]

    def servo(rate: float) -> Element:
        return Mean(Lag(0.004, DT, rate))

    return Made(
        {f"rate_{i}": r for i, r in enumerate(rates, 1)},
        lambda: Parts(actuators=(ThreeServos([servo(r) for r in rates[:3]], servo(rates[3])),)),
        "three swashplate servos slew at " + ", ".join(f"{r:.2f}" for r in rates[:3]) + " of full cyclic per second",
        {"rate": sum(rates[:3]) / 3},
    )


def _numb_servos(size: Sizes) -> Made:
    """Dead bands of pulses, and the collective moves all three servos through them, too."""
    width = size.between(0.010, 0.03)
    widths = [size.spread(width, 0.15) for _ in range(4)]
    return Made(
        {f"width_{i}": w for i, w in enumerate(widths, 1)},
        lambda: Parts(actuators=(ThreeServos([DeadBand(w) for w in widths[:3]], DeadBand(widths[3])),)),
        "three swashplate servos have dead bands of " + ", ".join(f"{w:.4f}" for w in widths[:3]),
        {},
    )


def _worn_links(size: Sizes) -> Made:
    half_width = size.between(0.008, 0.025)
    plays = [size.spread(half_width, 0.25) for _ in range(4)]
    return Made(
        {f"half_width_{i}": w for i, w in enumerate(plays, 1)},
        lambda: Parts(actuators=(ThreeServos([Backlash(w) for w in plays[:3]], Backlash(plays[3])),)),
        "three swashplate links have a play of " + ", ".join(f"{w:.4f}" for w in plays[:3]) + " each way",
        {},
    )


def _bottoming_plate(size: Sizes) -> Made:
    """The swashplate's dome meets the mast, and then the rods bend."""
    limit, give = size.at_most(0.07, 0.11), size.fixed(0.05, 0.15)
    return Made(
        {"limit": limit, "give": give},
        lambda: Parts(actuators=(Ring(limit, give),)),
        f"the swashplate meets the mast at {limit:.3f} of full command; {100 * give:.0f} % of more still gets through",
        {"limit": limit},
    )


# Rotor


def _inflow_in_wind_axes(size: Sizes) -> Made:
    # Hover inflow ratio of 0.05 to 0.08 at this disc loading; lift slope times solidity of a two-blade rotor.
    lam, a_sigma = size.fixed(0.04, 0.065), size.between(0.3, 0.55)
    airframe = size.airframe
    disc = PittPetersDisc(airframe.table, airframe.nominal_rpm, lam, a_sigma)
    return Made(
        {"inflow_ratio": lam, "lift_slope_solidity": a_sigma},
        lambda: Parts(rotor=PittPetersDisc(airframe.table, airframe.nominal_rpm, lam, a_sigma)),
        f"Pitt and Peters' inflow: mean inflow ratio {lam:.3f}, lift slope times solidity {a_sigma:.2f}",
        {"k_l": disc.K / (1 + disc.K), "tau_l": disc.time_s / (1 + disc.K)},
    )


def _offset_hinge(size: Sizes) -> Made:
    """Hinge springs and an offset: each follows the rotor speed in its own way."""
    offset = min(1.0, size.between(0.3, 0.8))
    airframe = size.airframe
    return Made(
        {"offset_share": offset},
        lambda: Parts(rotor=Disc(airframe.table, airframe.nominal_rpm, law=spring_and_offset(offset))),
        f"the rotor follows its speed, with {100 * offset:.0f} % of the hub's stiffness from the hinge offset",
        {"k": 1 - 0.5 * offset, "n": 2 * offset},
    )


def _propeller_in_oblique_flow(size: Sizes) -> Made:
    Z_a, A_alpha, B_alpha = size.fixed(1.5, 4.0), size.between(0.04, 0.12), size.sign() * size.between(0.03, 0.08)
    airframe = size.airframe
    return Made(
        {"Z_a": Z_a, "A_alpha": A_alpha, "B_alpha": B_alpha},
        lambda: Parts(rotor=ObliqueDisc(airframe.table, airframe.nominal_rpm, Z_a, A_alpha, B_alpha)),
        f"oblique flow tilts the disc by {A_alpha:.2f} and {B_alpha:.2f} rad per rad of angle of attack",
        {"A_alpha": A_alpha, "B_alpha": B_alpha},
    )


# Fuselage


def _turned_body(size: Sizes) -> Made:
    angle = size.sign() * min(0.3, size.between(0.06, 0.2))  # a payload or wing sweep, 3.5 to 11 degrees
    body = TurnedInertia(I_X, I_Y, I_Z, angle)
    return Made(
        {"angle": angle, "I_x": I_X, "I_y": I_Y, "I_z": I_Z},
        lambda: Parts(inertia=TurnedInertia(I_X, I_Y, I_Z, angle)),
        f"the principal axes are turned by {math.degrees(angle):.1f} degrees about the shaft",
        {"c_p": body.xy / body.xx},
    )


def _spinning_body(size: Sizes) -> Made:
    """Euler's equations and a disc that stands still in space while the body yaws beneath it."""
    I_z = I_X + I_Y - size.between(0.01, 0.07)  # a flat body has their sum
    airframe = size.airframe
    k_p, k_q = (I_Y - I_z) / I_X, (I_z - I_X) / I_Y
    return Made(
        {"I_x": I_X, "I_y": I_Y, "I_z": I_z},
        lambda: Parts(
            rotor=Disc(airframe.table, airframe.nominal_rpm, still=True),
            loads=(YawCoupling(k_p, k_q),),
        ),
        f"the yawing body couples its axes: I_z {I_z:.2f} kg m^2, and the disc stands still in space",
        {"k_p": k_p, "k_q": k_q},
    )


def _mooring(size: Sizes) -> Made:
    """A safety line under tension to the ground, hooked in below the centre of gravity."""
    tension, arm = size.between(5.0, 20.0), size.fixed(0.25, 0.5)  # N, m
    L_phi, M_theta = -tension * arm / I_X, -tension * arm / I_Y
    return Made(
        {"tension": tension, "arm": arm},
        lambda: Parts(loads=(Tether(L_phi, M_theta),)),
        f"a line pulls with {tension:.0f} N, {100 * arm:.0f} cm below the centre of gravity",
        {"L_phi": L_phi, "M_theta": M_theta},
    )


def _thrust_beside_the_centre(size: Sizes) -> Made:
    """Thrust follows its command with a lag and misses the centre of gravity."""
    thrust, right, ahead = 45.0, size.sign() * size.between(0.015, 0.05), size.sign() * size.between(0.01, 0.035)
    lag_s = size.fixed(0.015, 0.04)  # about one turn of the rotor
    tips, cant = 4.0, size.sign() * size.between(0.1, 0.35)  # N per command on both arms of 0.7 m; rad
    # Thrust up, to the right of the centre: right side up. Ahead of it: nose up.
    collective = (-thrust * right / I_X, thrust * ahead / I_Y)
    propellers = (tips * 0.7 * math.sin(cant) / I_X, 0.0)
    return Made(
        {"thrust": thrust, "right": right, "ahead": ahead, "lag_s": lag_s, "tip_thrust": tips, "cant": cant},
        lambda: Parts(loads=(ThrustLines(collective, propellers, lag_s),)),
        f"thrust acts {1e3 * right:.0f} mm right and {1e3 * ahead:.0f} mm ahead of the centre of gravity, "
        f"tip propellers are canted by {math.degrees(cant):.0f} degrees",
        {
            "L_delta_c": collective[0],
            "M_delta_c": collective[1],
            "L_delta_r": propellers[0],
            "M_delta_r": propellers[1],
        },
    )


def _wing_and_tail(size: Sizes) -> Made:
    """The wing's lift slope and the tail's: the elevator's own lift moves the vehicle, too."""
    Z_a, M_alpha, Z_e = size.fixed(1.5, 4.0), -size.between(12.0, 40.0), -size.fixed(0.1, 0.4)
    return Made(
        {"Z_a": Z_a, "M_alpha": M_alpha, "Z_e": Z_e},
        lambda: Parts(loads=(AngleOfAttack(Z_a, M_alpha, Z_e),)),
        f"wing and tail: Z_a {Z_a:.2f} 1/s, M_alpha {M_alpha:.1f} 1/s^2, the elevator lifts by {Z_e:.2f} rad/s",
        {"Z_a": Z_a, "M_alpha": M_alpha},
    )


# Sensors


def _turned_chip(size: Sizes) -> Made:
    yaw = size.sign() * size.between(0.06, 0.22)
    roll, pitch = size.spread(0.03, 1.0), -size.spread(0.03, 1.0)
    return Made(
        {"roll": roll, "pitch": pitch, "yaw": yaw},
        lambda: Parts(gyro=(RotatedChip(roll, pitch, yaw),)),
        f"the gyro sits turned by {math.degrees(yaw):.1f} degrees about the shaft and tilted by "
        f"{math.degrees(roll):.1f} and {math.degrees(pitch):.1f}",
        {"e": math.tan(yaw)},
    )


def _rubber_mount(size: Sizes) -> Made:
    frequency, zeta = size.at_most(12.0, 25.0), size.fixed(0.35, 0.7)  # gel pads under an autopilot
    w = 2 * math.pi * frequency
    return Made(
        {"frequency": frequency, "zeta": zeta},
        lambda: Parts(gyro=(SoftMount(w, zeta, DT),)),
        f"the autopilot sits on rubber of {frequency:.1f} Hz and damping ratio {zeta:.2f}",
        {"tau_g": 2 * zeta / w},
    )


RECIPES = (
    Recipe(id="three_slow_servos", answer="servo_lag", make=_three_slow_servos, accepts=("gyro_lag",), level=BELOW),
    Recipe(id="three_servo_motors", answer="servo_second_order", make=_three_servo_motors, level=BELOW),
    Recipe(id="servo_frame", answer="transport_delay", make=_servo_frame, level=BELOW),
    Recipe(id="tired_servos", answer="servo_rate_limit", make=_tired_servos, level=BELOW),
    Recipe(id="numb_servos", answer="servo_deadband", make=_numb_servos, level=BELOW),
    Recipe(id="worn_links", answer="servo_backlash", make=_worn_links, level=BELOW),
    Recipe(id="bottoming_plate", answer="servo_saturation", make=_bottoming_plate, level=BELOW),
    Recipe(id="inflow_in_wind_axes", answer="dynamic_inflow", make=_inflow_in_wind_axes, level=BELOW),
    Recipe(id="offset_hinge", answer="rotor_speed", make=_offset_hinge, level=BELOW, condition="rpm"),
    # The angle of attack comes into the catalogue with its own entry: either may be named.
    Recipe(
        id="propeller_in_oblique_flow",
        answer="disc_incidence",
        make=_propeller_in_oblique_flow,
        plants=(FORWARD,),
        accepts=("angle_of_attack",),
        level=BELOW,
    ),
    Recipe(id="turned_body", answer="inertia_coupling", make=_turned_body, level=BELOW),
    Recipe(id="spinning_body", answer="yaw_coupling", make=_spinning_body, level=BELOW, condition="yaw"),
    Recipe(id="mooring", answer="attitude_stiffness", make=_mooring, plants=(HOVER,), level=BELOW),
    Recipe(
        id="thrust_beside_the_centre",
        answer="input_coupling",
        make=_thrust_beside_the_centre,
        level=BELOW,
        condition="stirring",
    ),
    Recipe(id="wing_and_tail", answer="angle_of_attack", make=_wing_and_tail, plants=(FORWARD,), level=BELOW),
    Recipe(id="turned_chip", answer="gyro_misalignment", make=_turned_chip, level=BELOW),
    # In hover a filter in both gyros is the same filter in all servos, and this one is of second order.
    Recipe(
        id="rubber_mount",
        answer="gyro_lag",
        make=_rubber_mount,
        accepts=("servo_lag", "servo_second_order"),
        level=BELOW,
    ),
)
