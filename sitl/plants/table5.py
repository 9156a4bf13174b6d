"""The paper's Table 5: the numbers the simulated vehicle is made of in forward flight, free of Omega."""

from __future__ import annotations

from typing import NamedTuple

from sitl.plants.table4 import TipPathPlane


class Fuselage(NamedTuple):
    """What eq. 15-16 add to the rotor. 1/s, and rad/s^2 per full command."""

    L_p: float
    M_q: float
    M_elev: float


TABLE_5 = TipPathPlane(
    L_b=147.550, M_a=713.380, tau_f=0.075, A_b=-0.908, B_a=0.999, A_lat=-0.196, A_lon=0.214, B_lat=0.440, B_lon=-0.026
)

# M_q is positive as printed: no damping, but what the paper's fit made of effects that its model lacks.
TABLE_5_FUSELAGE = Fuselage(-0.930, 4.691, 37.752)
