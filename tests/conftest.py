"""What several folders of tests share: where the real logs are."""

from __future__ import annotations

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real logs; without it the test is skipped and says what was not proved."""
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("TIPPATH_SHARED_DATA", beside))
    if not folder.is_dir():
        pytest.skip(
            f"NO REAL LOGS: {folder} is absent, so nothing was checked against real flights; "
            "set TIPPATH_SHARED_DATA to the folder that holds ardupilot/ and crazyflie/"
        )
    return folder
