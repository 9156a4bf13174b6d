"""What is there already is not done again, and what was cut off goes on; no vehicle flies here."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from gcs.cards.maneuver import parse_card
from gcs.errors import TippathError
from gcs.paper.flights import FORWARD, HOVER_1, HOVER_2, LQR, Flown, Hangar, Planned
from gcs.paper.regenerate import PARTS, Part, Workshop, regenerate
from gcs.paper.values import Chapter


@dataclass(frozen=True, kw_only=True)
class FakeHangar(Hangar):
    """Writes a log where another flies."""

    flown: list[str] = field(default_factory=list)
    fails: tuple[str, ...] = ()

    def fly(self, planned: Planned) -> Flown:
        folder = self._folder(planned)
        self.flown.append(folder.path.name)
        if planned.name in self.fails:
            raise TippathError("the simulated vehicle ended: no reason")
        folder.log.write_bytes(planned.name.encode())
        return self._keep(planned, folder)


def part(key: str, needs: tuple[Planned, ...], made: list[str]) -> Part:
    def make(shop: Workshop) -> Chapter:
        made.append(key)
        return Chapter(heading="", inputs="", said=(f"of {key}",))

    return Part(key=key, heading=f"chapter {key}", needs=needs, make=make, takes_s=1.0)


def test_what_is_there_is_not_done_again(tmp_path: Path) -> None:
    made: list[str] = []
    told: list[str] = []
    parts = [part("a", (HOVER_1,), made), part("b", (HOVER_1, HOVER_2), made)]
    hangar = FakeHangar(path=tmp_path / "flights", quick=False)
    first = regenerate(tmp_path, hangar, told.append, parts)
    assert hangar.flown == ["hover-1", "hover-2"]
    assert made == ["a", "b"]
    assert [one.heading for one in first.chapters] == ["chapter a", "chapter b"]
    assert any("min left" in words for words in told)
    assert regenerate(tmp_path, hangar, told.append, parts) == first
    assert hangar.flown == ["hover-1", "hover-2"]
    assert made == ["a", "b"]
    (tmp_path / "flights" / "hover-2" / "flight.BIN").write_bytes(b"another")
    regenerate(tmp_path, hangar, told.append, parts)
    assert hangar.flown[2:] == ["hover-2.2"], "a log that is another now is no flight of ours, and stays"
    assert made[2:] == [], "the same samples give the same chapter"
    quick = FakeHangar(path=tmp_path / "flights", quick=True)
    regenerate(tmp_path, quick, told.append, parts)
    assert quick.flown == ["hover-1.2", "hover-2.3"], "another card is another flight"


def test_what_failed_is_flown_anew_and_what_was_done_stays(tmp_path: Path) -> None:
    made: list[str] = []
    parts = [part("a", (HOVER_1, HOVER_2), made)]
    failing = FakeHangar(path=tmp_path / "flights", quick=False, fails=("hover-2",))
    with pytest.raises(TippathError, match="ended"):
        regenerate(tmp_path, failing, lambda words: None, parts)
    assert made == []
    assert not (tmp_path / "paper.json").exists()
    hangar = FakeHangar(path=tmp_path / "flights", quick=False)
    regenerate(tmp_path, hangar, lambda words: None, parts)
    assert hangar.flown == ["hover-2.2"]
    assert made == ["a"]
    assert json.loads((tmp_path / "paper.json").read_text())["format"] == "tippath.paper/1"
    assert "of a" in (tmp_path / "paper.html").read_text()


def test_the_end_is_taken_between_two_steps(tmp_path: Path) -> None:
    hangar = FakeHangar(path=tmp_path / "flights", quick=False, aborted=lambda: "Ctrl-C")
    with pytest.raises(KeyboardInterrupt):
        regenerate(tmp_path, hangar, lambda words: None, [part("a", (HOVER_1,), [])])
    assert hangar.flown == []


def test_a_folder_that_cannot_be_made_is_told(tmp_path: Path) -> None:
    (tmp_path / "flights").write_text("a file")
    with pytest.raises(TippathError, match=r"cannot be made .*-o DIR"):
        regenerate(tmp_path, FakeHangar(path=tmp_path / "flights", quick=False), lambda words: None, PARTS)


def test_quick_flies_shorter_chirps() -> None:
    whole, quick = HOVER_1.test_card(False), HOVER_1.test_card(True)
    assert quick.duration_s < 0.7 * whole.duration_s
    assert [one.kind for one in quick.maneuvers] == [one.kind for one in whole.maneuvers]


@pytest.mark.parametrize("planned", [HOVER_1, FORWARD, LQR], ids=lambda one: one.name)
def test_a_quick_card_is_kept_as_it_is_flown(planned: Planned) -> None:
    card = planned.test_card(quick=True)
    assert card.duration_s <= planned.test_card(quick=False).duration_s
    assert parse_card(card.text, "card.toml").maneuvers == card.maneuvers
