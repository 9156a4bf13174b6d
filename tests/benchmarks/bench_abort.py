"""From the wish to end a run to the vehicle out of it, over loopback and at 20 % loss, beside one bare round trip.

The simulated vehicle flies as its own process; what counts is when the ground sees the other mode, so the way back of
the news is included. The peer is a parameter read over the same link at the same time: one question, one answer, no
decision. `make bench` prints the figures; nothing here asserts a time.
"""

from __future__ import annotations

import contextlib
import statistics
import threading
import time
from pathlib import Path

import pytest

from gcs.cards.maneuver import Maneuver, single_card
from gcs.demo.pilot import SimulatedVehicle
from gcs.flight.folder import create
from gcs.flight.run import Progress, RunProgress
from gcs.flight.run_state import Ending
from gcs.flight.session import Session
from gcs.flight.sweep import fly_card
from gcs.link.procedures import NoAnswerError, ReadParameter
from gcs.vehicle.autopilots import SYSTEMID

CARD = single_card(Maneuver(kind="chirp", axis="roll", amplitude=0.1, duration_s=20.0))
TIMES = 7
ABORT_AFTER_S = 2.0


def abort_once(session: Session, folder: Path) -> float:
    """Seconds from the wish, two seconds into a chirp, until the vehicle shows another mode."""
    wished: list[float] = []
    seen: list[float] = []

    def watch() -> None:
        while not seen and time.monotonic() < wished[0] + 30:
            if session.snapshot().mode != SYSTEMID:
                seen.append(time.monotonic())
            time.sleep(0.001)

    def on_progress(progress: Progress) -> None:
        if isinstance(progress, RunProgress) and progress.elapsed_s > ABORT_AFTER_S and not wished:
            wished.append(time.monotonic())
            threading.Thread(target=watch, daemon=True).start()

    flown = fly_card(
        session,
        CARD,
        folder=create(folder),
        on_progress=on_progress,
        aborted=lambda: "the bench" if wished else None,
    )
    assert flown.ending is Ending.ABORTED, flown.stopped
    return seen[0] - wished[0]


@pytest.mark.parametrize(("loss", "wanted_s"), [(0.0, 0.3), (0.2, 2.0)])
def bench_abort(loss: float, wanted_s: float, tmp_path: Path) -> None:
    with (
        SimulatedVehicle("hover-ideal", tmp_path / "vehicle", listen="udpin:127.0.0.1:0", loss=loss) as vehicle,
        Session.open(vehicle.ground_link) as session,
    ):
        aborts = [abort_once(session, tmp_path / f"flight-{i}") for i in range(TIMES)]
        reads = []
        for _ in range(50):
            began = time.monotonic()
            with contextlib.suppress(NoAnswerError):  # six tries are too few now and then
                session.call(ReadParameter("SID_AXIS"))
            reads.append(time.monotonic() - began)
    median, read = statistics.median(aborts), statistics.median(reads)
    print(
        f"\nabort at {100 * loss:.0f} % loss: median {1000 * median:.0f} ms, worst of {TIMES} {1000 * max(aborts):.0f} "
        f"(wanted {1000 * wanted_s:.0f}); {median / read:.1f} times one parameter read ({1000 * read:.0f} ms)"
    )
