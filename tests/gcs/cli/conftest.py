"""Commands ask the same of the same logs: what is tested here is what they make of it."""

from __future__ import annotations

import pytest


@pytest.fixture(scope="module", autouse=True)
def _logs_kept(logs_kept: None) -> None:
    """For modules that are about reading, `tests/gcs/logs`."""
