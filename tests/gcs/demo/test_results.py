"""What the demonstration leaves: gains on the fit with what was missing, and the report that a command writes."""

from __future__ import annotations

from pathlib import Path

import pytest
from flown_folder import fly_folder
from flying import LAG, LAG_CARD
from matplotlib.figure import Figure

import gcs.analysis.pages.page
from gcs.analysis.fits import split_runs
from gcs.demo.demo import identify_runs
from gcs.demo.discovery import discover
from gcs.demo.results import cleared_design, design_on, keep_results
from gcs.desk import Desk


@pytest.mark.thorough  # the whole report; `tests/gcs/demo/test_discovery.py` has which fit is the best
@pytest.mark.usefixtures("only_effects", "answers_kept")
@pytest.mark.parametrize("only_effects", [("flapping", "servo_lag", "quadratic_damping")], indirect=True)
def test_gains_are_for_the_fit_with_what_was_missing_and_the_folder_tells_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def counted(figure: Figure, **_: bool) -> str:
        return f"<svg>{len(figure.axes)} panels</svg>"

    monkeypatch.setattr(gcs.analysis.pages.page, "svg", counted)
    folder = fly_folder(tmp_path / "flight-0001", LAG, LAG_CARD)
    found, records = identify_runs(folder)
    discovery = discover(found.tpp, *split_runs(records), lambda _: None)
    assert discovery.addition is not None
    assert discovery.best is discovery.addition.after
    made = design_on(discovery, 5.0, folder.path)
    gentle = design_on(discovery, 20.0, folder.path)
    assert made.clearance.models[0][1] is discovery.best.model
    assert gentle.gains.margins.gain_db > made.gains.margins.gain_db
    told: list[str] = []
    assert cleared_design(discovery, (0.5, 20.0), folder.path, told.append).gains.input_cost == 20.0
    assert told[0].startswith("input cost 0.5 is not cleared: gain margin")
    keep_results(folder, found, discovery, made)
    report = (folder.path / "report.html").read_text()
    for part in ("The ladder to tpp-servo_lag.json", "What tpp.json lacks", "missing: servo_lag", "Gains, gains.json"):
        assert part in report, part
    desk = Desk()
    desk.open(str(folder.path))
    again = desk.state().designed
    assert again is not None
    assert again.rung == "TPP + servo_lag"
