"""The engine against the simulated vehicle as its own process, over a link that loses packets."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gcs.flight.gains import BANK, gains_of, push, revert
from gcs.flight.session import Session
from gcs.link.procedures import ReadAllParameters, ReadParameter, RefusedError, SetMode

pytestmark = pytest.mark.realtime


@pytest.fixture
def simulated(tmp_path: Path) -> Iterator[tuple[str, Path]]:
    """A vehicle on the ground, disarmed, losing 2 % of the packets of both directions: its link and its logs."""
    words = [sys.executable, "-m", "sitl", "--listen", "udpin:127.0.0.1:0", "-o", str(tmp_path / "vehicle")]
    process = subprocess.Popen(
        [*words, "--on-ground", "--loss", "0.02"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        ready = json.loads(process.stdout.readline())
        yield ready["ground_link"], tmp_path / "vehicle"
    finally:
        process.terminate()
        process.wait(5)
        process.stdin.close()
        process.stdout.close()


def test_record_push_and_revert(
    simulated: tuple[str, Path], tmp_path: Path, gains_document: dict[str, Any], until: Any
) -> None:
    link, logs = simulated
    # Next to nothing on a model that is stable by itself: the vehicle refuses what would not be.
    gains_document["K"] = [[0.001, 0.002, 0.003, 0.004], [0.005, 0.006, 0.007, 0.008]]
    gains_document["observer_gain"] = [[30.0, 1.0], [1.0, 30.0], [0.5, 0.2], [0.1, 0.4]]
    hover = {"L_b": 1000.0, "M_a": 700.0, "tau_f": 0.1, "A_b": 0.1, "B_a": 0.1}
    gains_document["model"]["parameters"] = hover | {"A_lat": 0.1, "A_lon": 1.0, "B_lat": 1.0, "B_lon": 0.1}
    first = gains_of(gains_document)
    gains_document["K"][0][0] = 0.0015
    second = gains_of(gains_document)
    with Session.open(link, primary=True) as session:
        session.start_recording(tmp_path / "ground")
        assert {f"LQS_{name}" for name in BANK} <= set(session.call(ReadAllParameters()))
        with pytest.raises(RefusedError, match="it says: "):
            session.call(SetMode(25))
        assert push(session, first).crc == first.crc
        assert push(session, second).previous_crc == first.crc
        assert revert(session).crc == first.crc
        assert session.call(ReadParameter("LQR_K11")).bits == first.bits[0]
        until(lambda: session.samples(5.0).t.size > 1000)
        until(lambda: (health := session.log_health()) and health.capacity and health.clock_s is not None)
        health = session.log_health()
        assert health is not None
        assert health.capacity is not None
        assert health.capacity.per_log_s == pytest.approx(48_200, rel=0.1)
        window = session.samples(5.0)
        assert np.diff(window.t) == pytest.approx(0.002)
        summary = session.stop_recording()
    assert summary.missing_blocks == 0
    assert summary.complete, summary.problems
    assert summary.log is not None
    assert summary.log.read_bytes() in [path.read_bytes() for path in logs.glob("*.BIN")]
