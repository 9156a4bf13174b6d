"""The paper's Table 4: the numbers the simulated hover vehicle is made of, free of Omega."""

from __future__ import annotations

from typing import NamedTuple


class TipPathPlane(NamedTuple):
    """Eq. 5-7. 1/s^2, s, and rad per full command."""

    L_b: float
    M_a: float
    tau_f: float
    A_b: float
    B_a: float
    A_lat: float
    A_lon: float
    B_lat: float
    B_lon: float


TABLE_4 = TipPathPlane(
    L_b=147.548, M_a=713.378, tau_f=0.091, A_b=-1.338, B_a=1.448, A_lat=-0.282, A_lon=0.296, B_lat=0.524, B_lon=-0.050
)

NOMINAL_RPM = 1650.0
