"""Known answers that nobody here made up: strangers' data with a hidden delay."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs.analysis.diagnosis import diagnose_fit
from gcs.analysis.text.checks import check_text
from gcs.logs import resolve_runs
from sysid.fit.checks import eigenfrequency_checks
from sysid.fit.identify import identify
from sysid.model.paper import TPP

STRANGERS = {"L_b": 3588.6, "M_a": 617.5, "tau_f": 0.068232}
"""Of ArduPilot's own helicopter simulator, which is a tip-path plane behind servos that are 50 ms late."""


@pytest.mark.data
@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("flapping", "gyro_lag", "servo_lag", "transport_delay")], indirect=True)
def test_the_strangers_delay_is_named_and_added(shared_data: Path) -> None:
    records = resolve_runs([str(shared_data / "ardupilot" / f"heli_{axis}_sweep.BIN") for axis in ("roll", "pitch")])
    fit = identify(TPP, records)
    assert 50 < fit.nrmse_percent["p"] < 62
    assert 38 < fit.nrmse_percent["q"] < 50
    found = diagnose_fit(fit, records)
    assert (found.last.verdict, found.last.effect) == ("missing", "transport_delay")
    assert found.last.confidence > 0.95
    after = found.added
    assert after is not None
    assert after.model["T_d"] == pytest.approx(0.050, abs=0.005)
    for name, value in STRANGERS.items():
        assert after.model[name] == pytest.approx(value, rel=0.05)
    assert min(after.nrmse_percent.values()) > 97
    inside = next(one for one in eigenfrequency_checks(after.model, records) if one.name == "inside the sweep")
    assert inside.passed is False
    assert "Hz" in check_text(inside)
