"""Play and dead bands that the imposed commands hardly tell apart, by what they foretell."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import pytest
from strangers.asking import ask_runs

from sysid.data.record import Record
from sysid.diagnose import choice
from sysid.diagnose.candidates import Ranked
from sysid.diagnose.choice import FORETELLS, RESTS_ALIKE
from sysid.diagnose.foretold import foretells_better_by
from sysid.model.compose import compose
from sysid.model.paper import TPP
from sysid.model.structure import Model

SEED = 4054348
"""A judged one's: play of 4.5 times what is just detectable, a dead band by chi squared of 9."""
RESTING = ("servo_deadband", "servo_backlash")


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [RESTING], indirect=True)
def test_play_is_no_dead_band_that_foretells_less(
    fitted_stranger: list[Record], monkeypatch: pytest.MonkeyPatch
) -> None:
    found = ask_runs(fitted_stranger)
    assert (found.verdict, found.effect) == ("missing", "servo_backlash")
    fits = {one.effect: one.fit for one in found.candidates}
    play, band = fits["servo_backlash"], fits["servo_deadband"]
    assert play is not None
    assert band is not None
    assert foretells_better_by(play, band) > FORETELLS
    assert foretells_better_by(band, play) < -FORETELLS
    monkeypatch.setattr(choice, "foretells_better_by", lambda *_: 0.0)
    assert ask_runs(fitted_stranger).effect == "servo_deadband"


def ranked(*effects: str, measured: bool = True) -> Ranked:
    structure = compose("tpp", effects, frozenset(TPP.inputs))
    fit = SimpleNamespace(
        model=Model(structure, structure.vector(dict.fromkeys(structure.names, 1.0))),
        division=SimpleNamespace(measured=measured),
    )
    return Ranked(
        effects=effects, score=None, not_testable=None, fit=cast("Any", fit), stepped=cast("Any", SimpleNamespace())
    )


def test_only_what_rests_is_asked_so_and_only_where_what_was_imposed_tells_little(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    behind, better = RESTS_ALIKE - 1, FORETELLS + 1
    monkeypatch.setattr(choice, "gain", lambda *_: (behind, 0.0))
    monkeypatch.setattr(choice, "foretells_better_by", lambda *_: better)
    play, band = ranked("servo_backlash"), ranked("servo_deadband")
    assert choice._foretells_at_rest(play, band)
    assert choice._foretells_at_rest(ranked("servo_lag", "servo_backlash"), ranked("servo_lag", "servo_deadband"))
    assert not choice._foretells_at_rest(replace(play, implausible=("half_width",)), band)
    assert not choice._foretells_at_rest(ranked("servo_backlash", "servo_lag"), band)
    assert not choice._foretells_at_rest(ranked("servo_lag"), band)
    assert not choice._foretells_at_rest(
        ranked("servo_backlash", measured=False), ranked("servo_deadband", measured=False)
    )
    behind = RESTS_ALIKE + 1
    assert not choice._foretells_at_rest(play, band)
    behind, better = 0.0, FORETELLS - 1
    assert not choice._foretells_at_rest(play, band)
