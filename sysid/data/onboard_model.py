"""A response that the vehicle identified itself in flight: a second opinion beside what is fitted to the same run.

PX4's autotune: an ARX model of orders 2, 2 and a delay of one sample, by recursive least squares (src/lib/
system_identification, arx_rls.hpp). Command and rate are low-passed alike before they are sampled, so that its response
is the vehicle's own, without a hold of its slow samples.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

FASTEST = 0.25
"""Of its sampling rate: its highest frequency that is compared; nearer to half the rate the low-pass leaves little."""


@dataclass(frozen=True, kw_only=True)
class OnboardModel:
    """output(z) / command(z) = z^-1 (b0 + b1 z^-1 + b2 z^-2) / (1 + a1 z^-1 + a2 z^-2)."""

    output: str
    """A channel, its unit as in records."""
    command: str
    a: tuple[float, ...]
    b: tuple[float, ...]
    dt_s: float
    """Between its samples."""
    told_by: str

    def response(self, frequency_hz: NDArray[np.float64]) -> NDArray[np.complex128]:
        """(f,), output per command, as its samples answer each other."""
        back = np.exp(-2j * np.pi * frequency_hz * self.dt_s)
        above = sum(b * back**k for k, b in enumerate(self.b, 1))
        return np.asarray(above / (1 + sum(a * back**k for k, a in enumerate(self.a, 1))), np.complex128)

    @property
    def poles(self) -> tuple[complex, ...]:
        """1/s, of the continuous model that it samples; slowest first, without those that answer within a sample."""
        z = np.roots([1.0, *self.a]).astype(complex)
        z = z[np.abs(z) > 1e-6]
        return tuple(sorted((complex(np.log(one) / self.dt_s) for one in z), key=abs))

    @property
    def highest_hz(self) -> float:
        return FASTEST / self.dt_s

    def to_json(self) -> dict[str, Any]:
        return asdict(self)
