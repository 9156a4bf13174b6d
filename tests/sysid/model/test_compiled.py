"""Loops over samples give the same, compiled, kept nowhere, or as they are written."""

from __future__ import annotations

import errno
import pickle
import subprocess
import sys
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest
from numba.core import caching

from sysid.effects import servo_acceleration_limit, servo_backlash, servo_deadband, servo_rate_limit
from sysid.model.compiled import Compiled

LOOPS: tuple[tuple[Any, str, Mapping[str, float]], ...] = (
    (servo_backlash, "_push", {"half_width": 0.02}),
    (servo_deadband, "_hold", {"width": 0.02}),
    (servo_rate_limit, "_follow", {"rate": 2.0}),
    (servo_acceleration_limit, "_approach", {"acceleration": 50.0}),
)


@pytest.fixture
def commands() -> Any:
    """Two that wander and jump."""
    draw = np.random.default_rng(7)
    steps = 0.002 * draw.normal(size=(2, 4000)) + 0.2 * draw.normal(size=(2, 4000)) * (draw.random((2, 4000)) < 0.002)
    return np.cumsum(steps, axis=1)


def without_numba(monkeypatch: Any) -> None:
    monkeypatch.setitem(sys.modules, "numba", None)


def without_a_folder(monkeypatch: Any) -> None:
    monkeypatch.setattr(caching.CacheImpl, "_locator_classes", [])


def with_a_full_disk(monkeypatch: Any) -> None:
    def full(*_: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(caching.IndexDataCacheFile, "save", full)
    monkeypatch.setattr(caching.IndexDataCacheFile, "load", lambda *_: None)


def with_a_damaged_cache(monkeypatch: Any) -> None:
    def damaged(*_: Any) -> None:
        raise pickle.UnpicklingError("pickle data was truncated")

    monkeypatch.setattr(caching.IndexDataCacheFile, "load", damaged)


@pytest.mark.parametrize(("effect", "name", "parameters"), LOOPS, ids=lambda one: getattr(one, "__name__", None))
@pytest.mark.parametrize("trouble", [without_numba, without_a_folder, with_a_full_disk, with_a_damaged_cache])
def test_loops_give_the_same_however_they_run(
    effect: Any,
    name: str,
    parameters: Mapping[str, float],
    trouble: Callable[[Any], None],
    commands: Any,
    monkeypatch: Any,
) -> None:
    compiled = effect.samples(commands, 0.002, parameters)
    assert not np.array_equal(compiled, commands)
    trouble(monkeypatch)
    again = Compiled(getattr(effect, name).loop)
    monkeypatch.setattr(effect, name, again)
    assert np.max(np.abs(effect.samples(commands, 0.002, parameters) - compiled)) < 1e-14
    assert len(again._ways) == (1 if trouble is without_numba else 2)


def test_what_is_wrong_in_a_loop_itself_is_told() -> None:
    @Compiled
    def divides(command: Any, acting: Any, by: float) -> None:
        acting[0] = 1.0 / by

    with pytest.raises(ZeroDivisionError):
        divides(np.zeros((1, 1)), 0.0)


def test_columns_that_are_not_next_to_each_other_are_read_and_written(commands: Any) -> None:
    beside = np.asfortranarray(commands)
    parameters = {"half_width": 0.02}
    np.testing.assert_array_equal(
        servo_backlash.samples(beside, 0.002, parameters), servo_backlash.samples(commands, 0.002, parameters)
    )


def test_numba_is_not_imported_before_a_loop_runs() -> None:
    code = "import sys, sysid.effects.servo_backlash, gcs.cli; assert 'numba' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
