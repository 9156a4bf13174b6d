"""Loops over samples, compiled where numba is there: what a sample does depends on the one before.

Numba takes half a second to begin, longer than most commands to answer, so the first loop that runs asks for it. What
it compiled it keeps beside the file, or in the user's cache folder. Where that is damaged or full it is compiled anew;
without numba, or with one that does not know the NumPy at hand, the same loop runs as it is written, twenty to eighty
times slower.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import cached_property

import numpy as np

from sysid.data.record import FloatArray


class Compiled:
    """A loop over one command's samples (n,), that writes those that act into a second array; then numbers.

    Called with commands (c, n) and the numbers it gives those that act, (c, n).
    """

    def __init__(self, loop: Callable[..., None]) -> None:
        self.loop = loop

    def __call__(self, commands: FloatArray, *numbers: float) -> FloatArray:
        acting = np.empty_like(commands)
        for command, row in zip(commands, acting, strict=True):
            self._run(command, row, *numbers)
        return acting

    def _run(self, *given: object) -> None:
        while True:
            try:
                return self._ways[0](*given)
            except Exception:  # of the compiler or its cache; of the loop itself, where it runs as written
                if len(self._ways) == 1:
                    raise
                del self._ways[0]

    @cached_property
    def _ways(self) -> list[Callable[..., None]]:
        """The best first."""
        try:
            import numba
        except ImportError:
            return [self._written]
        found: list[Callable[..., None]] = []
        for kept in (True, False):
            with suppress(RuntimeError):  # there is no folder to keep it in
                found.append(numba.njit(cache=kept)(self.loop))
        return [*found, self._written]

    def _written(self, *given: object) -> None:
        # a view's numbers are Python's own, and had in a third of the time
        self.loop(*(one.data if isinstance(one, np.ndarray) else one for one in given))
