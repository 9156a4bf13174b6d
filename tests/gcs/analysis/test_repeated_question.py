"""A diagnosis that is repeated: where it stops."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from planted import PLANTED, fly_many
from planted_fits import records

import gcs.analysis.diagnosis
from gcs.analysis.diagnosis import NotSure, diagnose_fit
from gcs.analysis.text.remarks import remark_text
from sysid.diagnose.diagnose import diagnose
from sysid.fit.identify import identify
from sysid.model.compose import compose


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("servo_lag", "inertia_coupling")], indirect=True)
def test_nothing_is_asked_beside_a_guess(monkeypatch: pytest.MonkeyPatch) -> None:
    def guessing(*asked: Any, **named: Any) -> Any:
        return replace(diagnose(*asked, **named), confidence=0.23)

    flight = records(fly_many("servo_lag", PLANTED["servo_lag"], seeds=[31], duration_s=10.0)[0])
    fit = identify(compose("tpp"), flight)
    monkeypatch.setattr(gcs.analysis.diagnosis, "diagnose", guessing)
    found = diagnose_fit(fit, flight, repeat=True)
    assert (found.last.verdict, found.last.effect) == ("missing", "servo_lag")
    assert len(found.rungs) == 1
    assert found.grown is None
    (remark,) = [one for one in found.remarks if isinstance(one, NotSure)]
    assert "not added: servo_lag has a confidence of 0.23 only" in remark_text(remark)
    assert diagnose_fit(fit, flight).added is not None
