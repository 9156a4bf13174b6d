"""Cases that are one more of a kind that the suite has already: `make study` runs them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def thorough(cases: Iterable[Any]) -> list[Any]:
    """Each as a case of `parametrize`, of one argument or, as a tuple, of several."""
    return [pytest.param(*(one if isinstance(one, tuple) else (one,)), marks=pytest.mark.thorough) for one in cases]
