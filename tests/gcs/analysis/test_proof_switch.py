"""Whether the pilot's switch selected the set that is proved: by what was said in the log, else by its parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import pytest

from gcs.analysis.proof import _require_flown
from gcs.errors import TippathError

CRC = 0x8BA38F


@dataclass
class Log:
    """As much of a log as is asked."""

    switch: float | None
    said: list[tuple[float, str]]
    active: int | None = CRC

    def parameters(self, t: float) -> dict[str, float]:
        told = {"LQR_SW": self.switch, "LQR_ACTIVE": self.active}
        return {name: float(value) for name, value in told.items() if value is not None}

    def texts(self) -> list[tuple[float, str]]:
        return self.said


@dataclass
class Run:
    start_s: float = 10.0


def flew(log: Any) -> None:
    run: Any = Run()
    _require_flown(log, run, CRC)


@pytest.mark.parametrize(
    ("switch", "said"),
    [(1, []), (0, [(5.0, "LQR on")]), (1, [(5.0, "LQR off"), (6.0, "LQR on")]), (1, [(20.0, "LQR off")])],
    ids=["turned before the log began", "turned in it", "turned twice", "turned after the run"],
)
def test_a_set_that_the_switch_selects_flew(switch: float, said: list[tuple[float, str]]) -> None:
    flew(Log(switch, said))


@pytest.mark.parametrize(
    ("switch", "said"),
    [(0, []), (None, []), (1, [(5.0, "LQR off")]), (0, [(20.0, "LQR on")])],
    ids=["off", "not told", "turned off in it", "turned on after the run"],
)
def test_without_a_word_of_the_switch_no_set_flew(switch: float | None, said: list[tuple[float, str]]) -> None:
    with pytest.raises(TippathError, match="did not select"):
        flew(Log(switch, said))


def test_another_set_is_told_by_its_checksum() -> None:
    with pytest.raises(TippathError, match="another set flew"):
        flew(Log(1, [], active=0x123456))
