"""What several folders of tests share: where the real logs are."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

os.environ["TIPPATH_CACHE"] = "off"  # tests read logs anew, and write nothing beside those they do not own


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


@pytest.fixture
def tippath(capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str, str]]:
    """The command line in this process: words -> exit status, standard output and error; never a traceback."""
    from gcs.cli import main

    def run(*words: object) -> tuple[int, str, str]:
        try:
            status = main([str(word) for word in words])
        except SystemExit as stop:  # argparse
            status = int(stop.code or 0)
        out, err = capsys.readouterr()
        assert "Traceback" not in out + err
        return status, out, err

    return run
