"""A stranger that a file's tests share: the file says which by its SEED."""

from __future__ import annotations

import pytest
from strangers.asking import fitted_runs
from strangers.flights import Stranger, fly

from sysid.data.record import Record


@pytest.fixture(scope="module")
def flown(request: pytest.FixtureRequest) -> Stranger:
    return fly(request.module.SEED)


@pytest.fixture(scope="module")
def runs(flown: Stranger) -> list[Record]:
    """Of its flight, those to be fitted."""
    return fitted_runs(flown)
