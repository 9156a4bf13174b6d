"""What the demonstration tells at its end: the effect that was planted, and the error with it."""

from __future__ import annotations

import planted
import pytest
from planted_fits import records

from gcs.demo.discovery import discover
from sysid.fit.identify import identify
from sysid.model.compose import compose

LAG = [("flapping", "servo_lag", "quadratic_damping")]


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", LAG, indirect=True)
@pytest.mark.parametrize("effect", ["servo_lag", None])
def test_it_names_what_is_missing_and_adds_it_or_says_that_nothing_is(effect: str | None) -> None:
    sizes = {} if effect is None else planted.PLANTED[effect]
    flown = records(planted.fly(effect, sizes, seed=3, gusts=0.3, duration_s=15.0))
    chirps, judging = flown[::2], flown[1::2]
    told: list[str] = []
    found = discover(identify(compose("tpp"), chirps), chirps, judging, told.append)
    document = found.to_json()
    if effect is None:
        assert (document["verdict"], found.addition) == ("complete", None)
        assert document["nrmse_percent_with_it"] is None
        assert found.best is found.diagnosis.fit
        assert told[-1].startswith("complete, confidence 0.")
        return
    assert (document["verdict"], document["effect"]) == ("missing", effect)
    assert told[1].startswith("missing: servo_lag, confidence ")
    assert told[2].startswith("servo_lag: the error falls")
    assert "+ servo_lag" in found.text
    assert found.text.startswith("missing: servo_lag")
    assert found.addition is not None
    assert found.best is found.addition.after
    assert document["nrmse_percent_with_it"]["p"] > found.addition.before.nrmse_percent["p"]
