"""Draws that the catalogue does not have: a good diagnosis says `unexplained` and forces them onto no entry."""

from __future__ import annotations

from sitl.hidden.recipe import BEYOND, FORWARD, Made, Recipe, Sizes, on_each
from sitl.plants.actuators import Fading, LazyLag, Uneven
from sitl.plants.fuselages import ForwardFuselage
from sitl.plants.hover import DT
from sitl.plants.rotorcraft import NOMINAL_AIRSPEED, Parts
from sitl.plants.rotors import RubberHub, StickingHinge, StiffeningHub


def _stiffening_hub(size: Sizes) -> Made:
    knee = size.at_most(0.035, 0.08)  # rad: dampers that bottom out at 2 to 5 degrees
    airframe = size.airframe
    return Made(
        {"knee": knee},
        lambda: Parts(rotor=StiffeningHub(airframe.table, airframe.nominal_rpm, knee)),
        f"the hub stiffens with its tilt, to twice its stiffness at {knee:.3f} rad",
    )


def _rubber_hub(size: Sizes) -> Made:
    more, time_s = size.between(0.3, 0.9), size.fixed(0.03, 0.12)  # filled rubber: up to twice as stiff when quick
    airframe = size.airframe
    return Made(
        {"more": more, "time_s": time_s},
        lambda: Parts(rotor=RubberHub(airframe.table, airframe.nominal_rpm, more, time_s)),
        f"the hub's rubber remembers: {100 * more:.0f} % stiffer for tilts quicker than {1e3 * time_s:.0f} ms",
    )


def _sticking_hinge(size: Sizes) -> Made:
    friction = size.between(0.002, 0.006)  # rad of cyclic: 0.1 to 0.35 degree, dry bearings under centrifugal load
    airframe = size.airframe
    return Made(
        {"friction": friction},
        lambda: Parts(rotor=StickingHinge(airframe.table, airframe.nominal_rpm, friction)),
        f"the flapping hinges stick, with {friction:.4f} rad of cyclic",
    )


def _uneven_horns(size: Sizes) -> Made:
    more = min(0.6, size.between(0.12, 0.4))  # horns 10 to 20 degrees off
    return Made(
        {"more": more},
        lambda: Parts(actuators=(Uneven(more),)),
        f"commands act {100 * more:.0f} % stronger to one side and weaker to the other",
    )


def _lazy_servos(size: Sizes) -> Made:
    quick, slow, scale = 0.006, size.between(0.05, 0.15), size.fixed(0.008, 0.02)
    return Made(
        {"tau_large": quick, "tau_small": slow, "scale": scale},
        on_each(lambda: LazyLag(quick, slow, scale, DT), moves=True),
        f"servos are quick for large errors and slow, {1e3 * slow:.0f} ms, below {scale:.3f}",
    )


def _fading_battery(size: Sizes) -> Made:
    share = size.between(0.15, 0.4)  # of control, over two minutes: a cold or tired battery
    return Made(
        {"share": share, "after_s": 120.0},
        lambda: Parts(actuators=(Fading(share, 120.0, DT),)),
        f"controls fade by {100 * share:.0f} % in two minutes",
    )


def _stalling_elevator(size: Sizes) -> Made:
    stall = size.at_most(0.2, 0.35)  # of full deflection
    numbers = size.airframe.fuselage
    assert numbers is not None
    return Made(
        {"stall": stall},
        lambda: Parts(fuselage=ForwardFuselage(*numbers, NOMINAL_AIRSPEED, stall=stall)),
        f"the elevator stalls at {stall:.2f} of its deflection",
    )


RECIPES = (
    Recipe(id="stiffening_hub", answer=None, make=_stiffening_hub, level=BEYOND),
    Recipe(id="rubber_hub", answer=None, make=_rubber_hub, level=BEYOND),
    Recipe(id="sticking_hinge", answer=None, make=_sticking_hinge, level=BEYOND),
    Recipe(id="uneven_horns", answer=None, make=_uneven_horns, level=BEYOND),
    Recipe(id="lazy_servos", answer=None, make=_lazy_servos, level=BEYOND),
    Recipe(id="fading_battery", answer=None, make=_fading_battery, level=BEYOND),
    Recipe(id="stalling_elevator", answer=None, make=_stalling_elevator, plants=(FORWARD,), level=BEYOND),
)
