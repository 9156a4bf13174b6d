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


TABLE_4 = TipPathPlane(147.548, 713.378, 0.091, -1.338, 1.448, -0.282, 0.296, 0.524, -0.050)

NOMINAL_RPM = 1650.0
