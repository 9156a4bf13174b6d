"""What the paper prints, beyond what the analysis shows beside any fit (`gcs.analysis.text.fit`). Slips of the text are
corrected: the parameters of its Table 5 are free of Omega, as its caption says.
"""

from __future__ import annotations

from types import MappingProxyType

TABLE_1 = MappingProxyType({"start, Hz": 0.5, "end, Hz": 10.0, "noise fraction": 0.2, "C_1": 4.0, "C_2": 0.018657})
"""C_2 = 1/(exp(C_1) - 1). Length and amplitude are not in it; the figures show about 30 s."""

TABLE_5 = MappingProxyType(
    {
        "tpp": {
            "A_b": -0.908, "B_a": 0.999, "L_b": 147.550, "M_a": 713.380, "tau_f": 0.075, "A_lat": -0.196,
            "A_lon": 0.214, "B_lat": 0.440, "B_lon": -0.026, "L_p": -0.930, "M_q": 4.691, "M_elev": 37.752,
        },
        "cd": {
            "L_p": -10.690, "M_p": 14.899, "L_q": -9.251, "M_q": 1.050, "L_lat": 6.605, "M_lat": -70.459,
            "L_lon": -2.903, "M_lon": 11.532, "M_elev": 10.263,
        },
    }
)  # fmt: skip

TABLE_6 = MappingProxyType(
    {
        ("tpp", "fitted"): (66.0, 54.7),
        ("cd", "fitted"): (70.8, 21.7),
        ("tpp", "validation"): (49.7, 47.1),
        ("cd", "validation"): (53.1, 17.0),
    }
)
"""NRMSE of p and q, percent."""

TWO_SETS = MappingProxyType({"parameters": 7.7, "eigenfrequencies": 0.9, "damping ratios": 1.8})
"""Largest change between two sets of chirps, percent."""

SCALED_BY_THEORY = MappingProxyType({"parameters": 185.0, "eigenfrequencies": 4.0, "damping ratios": 28.0})
"""Section 4.3: largest change from 1500 to 1650 RPM, percent; of modes after scaling by theory."""
SLOW_ON_FAST = (72.4, 67.1)
"""Section 4.3: NRMSE of the 1500 RPM model on Table 3's chirps, percent."""
