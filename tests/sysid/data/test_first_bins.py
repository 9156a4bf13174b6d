"""The first bins of samples, judged by NumPy's transform of all of them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import scipy.fft

from sysid.data.first_bins import SLOW_FACTOR, first_bins, largest_factor


@pytest.mark.parametrize("samples", [1000, 1009, 5 * 1009, 8 * 211, 21011])
@pytest.mark.parametrize("rows", [1, 2, 3])
def test_they_are_those_of_the_whole_transform(samples: int, rows: int) -> None:
    x = np.random.default_rng(samples).standard_normal((rows, samples))
    x[0] *= 1e3  # what shares a transform does not leak
    every = np.fft.rfft(x, axis=1)
    for count in (1, 2, samples // 40, samples // 8, samples // 2 + 1):
        found = first_bins(x, count)
        assert found.shape == (rows, count)
        np.testing.assert_allclose(found, every[:, :count], atol=1e-10 * np.abs(every).max())


def test_no_transform_is_of_a_length_with_a_large_factor(monkeypatch: pytest.MonkeyPatch) -> None:
    """They took a fifth of a diagnosis: a run is as long as it was flown."""
    lengths: list[int] = []

    def counted(whole: Callable[..., np.ndarray]) -> Callable[..., np.ndarray]:
        def transform(x: np.ndarray, n: int | None = None, axis: int = -1) -> np.ndarray:
            lengths.append(n or x.shape[axis])
            return whole(x, n, axis=axis)

        return transform

    for name in ("rfft", "fft", "ifft"):
        monkeypatch.setattr(scipy.fft, name, counted(getattr(scipy.fft, name)))
    for samples in (4800, 4801, 4802, 4813, 21011):
        first_bins(np.ones((2, samples)), 100)
    assert len(lengths) > 5
    assert all(largest_factor(length) < SLOW_FACTOR for length in lengths)


def test_the_largest_prime_factor() -> None:
    assert [largest_factor(n) for n in (1, 2, 12, 97, 2 * 97, 49, 21011)] == [1, 2, 3, 97, 97, 7, 21011]
