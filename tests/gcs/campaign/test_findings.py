"""What many flights say: changes named where they sit, dated, and told of nothing else; and the page of them."""

from __future__ import annotations

from html.parser import HTMLParser
from pathlib import Path

import msgspec
import numpy as np
import pytest
from campaign_flights import BEGIN, STEP_DAY, outcomes

from gcs.campaign.findings import Findings, found
from gcs.campaign.page import campaign_page, write_page
from gcs.campaign.sentences import apart_sentence, dependence_sentence, event_sentence, nothing_sentence, remarks
from gcs.campaign.work import AtBound, Outcome

DAY = int(BEGIN.timestamp() // 86400) + STEP_DAY
HOSTILE = "</td><script>alert(1)</script>\" onload='x' {{ 7*7 }} & 日本"


def test_a_step_and_a_drift_are_named_dated_and_sized_each_in_its_vehicle() -> None:
    said = found({"A": outcomes(step={"T_d": 0.01}), "B": outcomes(seed=5, vehicle="B", drift={"L_b": -15.0})})
    step, drift = said.events
    assert (step.group, step.kind, step.named, step.sizes[0].parameter) == ("A", "step", "one", "T_d")
    assert step.days[0] < DAY <= step.days[1]
    assert abs(step.sizes[0].size - 0.01) < 4 * step.sizes[0].error
    assert (drift.group, drift.kind, drift.named, drift.sizes[0].parameter) == ("B", "drift", "one", "L_b")
    assert abs(drift.sizes[0].size + 15.0) < 4 * drift.sizes[0].error
    assert said.claims == 2
    words = event_sentence(step)
    assert "flights since" in words
    assert "more T_d (delay of the commands)" in words
    assert "falls by" in event_sentence(drift)


def test_a_delay_that_was_none_is_seen_to_come_though_fits_ended_at_its_bound() -> None:
    flights = outcomes(step={"T_d": 0.010}, zero="T_d", correlation=0.0, spread=0.0)
    assert sum("T_d" in one.fit.at_bound for one in flights if one.fit is not None) >= 5
    (event,) = found({"A": flights}).events
    assert (event.kind, event.named, event.sizes[0].parameter) == ("step", "one", "T_d")
    assert event.days[0] < DAY <= event.days[1]
    assert abs(event.sizes[0].size - 0.010) < 4 * event.sizes[0].error
    before = [one for one in flights if one.when is not None and one.when.day < DAY]
    all_at_bound = [_ended(one, "T_d") for one in before] + list(flights[len(before) :])
    (event,) = found({"A": all_at_bound}).events
    assert (event.named, event.sizes[0].parameter) == ("one", "T_d")
    assert found({"A": [_ended(one, "T_d") for one in flights]}).claims == 0


def _ended(one: Outcome, name: str) -> Outcome:
    """With a parameter at its bound."""
    assert one.fit is not None
    places = [place for place, other in enumerate(one.fit.parameters) if other != name]
    fit = msgspec.structs.replace(
        one.fit,
        parameters={other: number for other, number in one.fit.parameters.items() if other != name},
        covariance=tuple(tuple(one.fit.covariance[i][j] for j in places) for i in places),
        at_bound={name: AtBound(value=0.0, unit="s")},
    )
    return msgspec.structs.replace(one, fit=fit)


@pytest.mark.thorough
def test_values_at_a_bound_make_no_claims_where_nothing_changed() -> None:
    groups = [{v: outcomes(seed=2 * k + n, vehicle=v, zero="T_d") for n, v in enumerate("AB")} for k in range(100)]
    assert sum(found(each, seed).claims > 0 for seed, each in enumerate(groups)) <= 5


def test_what_the_fits_cannot_tell_apart_is_named_as_a_class() -> None:
    """A delay that shows in the sum with a lag alone: each of the two is too uncertain by itself."""
    flights = outcomes(60, step={"T_d": 0.0012}, correlation=-0.995, spread=0.0)
    said = found({"A": flights})
    (event,) = said.events
    assert event.named == "class"
    assert {one.parameter for one in event.sizes} == {"T_d", "tau_s"}
    assert "do not tell in which" in event_sentence(event)
    assert not said.courses["A", "T_d"].claimed


def test_what_several_parameters_show_at_once_is_no_single_ones() -> None:
    (event,) = found({"A": outcomes(step={"L_b": 12.0, "M_a": -60.0})}).events
    assert event.named == "several"
    assert {one.parameter for one in event.sizes} == {"L_b", "M_a"}


def test_another_rotor_speed_is_not_the_vehicles_change() -> None:
    flights = outcomes(per_rotor_speed={"M_a": 6.0})
    said = found({"A": flights})
    assert not said.events
    (one,) = said.goes_with
    assert (one.parameter, one.condition, one.or_time) == ("M_a", "omega", False)
    assert abs(one.size - 6.0) < 4 * one.error
    assert "no change of the vehicle" in dependence_sentence(one)
    days = sorted({flight.when.day for flight in flights if flight.when is not None})
    faster = [_at(flight, 170.0 if flight.when and flight.when.day < days[len(days) // 2] else 175.0, 8.0)
              for flight in outcomes()]  # fmt: skip
    said = found({"A": faster})
    assert not said.events
    assert [one.or_time for one in said.goes_with if one.parameter == "M_a"] == [True]


def _at(one: Outcome, omega: float, per: float) -> Outcome:
    """Flown with another rotor speed, on which M_a depends."""
    assert one.fit is not None
    M_a = one.fit.parameters["M_a"]
    moved = msgspec.structs.replace(M_a, value=M_a.value + per * (omega - 172.0))
    fit = msgspec.structs.replace(one.fit, parameters={**one.fit.parameters, "M_a": moved})
    jitter = np.random.default_rng(int(one.key, 16) % 2**32).normal(0, 0.1)
    return msgspec.structs.replace(one, conditions={"omega": omega + jitter}, fit=fit)


def test_nothing_is_claimed_where_nothing_changed_and_copies_count_once() -> None:
    flights = outcomes()
    copies = [msgspec.structs.replace(flights[3], path=f"logs/z/{n}.BIN") for n in range(30)]
    said = found({"A": (*flights, *copies)})
    assert said.claims == 0
    assert len(said.copies) == 30
    assert set(said.copies.values()) == {flights[3].path}
    assert "No change is told" in nothing_sentence(said)
    assert remarks(said)[0].startswith("30 logs are of a flight")
    assert sum(len(one) for one in said.courses["A", "L_b"].days.flights) == len(flights)


def test_the_same_seed_finds_the_same_and_its_document_has_no_number_that_is_none() -> None:
    flights = {"A": outcomes(20), "B": outcomes(2, seed=3), "C": outcomes(1, seed=4), "D": ()}
    first, again = found(flights, 1), found(flights, 1)
    assert msgspec.json.encode(first.to_json()) == msgspec.json.encode(again.to_json())
    assert b"NaN" not in msgspec.json.encode(first.to_json())
    assert {group for group, _ in first.courses} == {"A", "B"}


@pytest.fixture(scope="module")
def full() -> tuple[Findings, dict[str, tuple[Outcome, ...]], list[Outcome]]:
    flights = list(outcomes(step={"M_a": 60.0}))
    fit = flights[20].fit
    assert fit is not None
    far = msgspec.structs.replace(fit.parameters["L_b"], value=200.0)
    fit = msgspec.structs.replace(fit, parameters={**fit.parameters, "L_b": far})
    flights[20] = msgspec.structs.replace(flights[20], path=f"logs/{HOSTILE}.BIN", fit=fit)
    groups = {HOSTILE: tuple(flights), "B": outcomes(12, seed=2, vehicle="B")}
    bad = [
        msgspec.structs.replace(one, path=f"logs/bad {n}.BIN", fit=None, reason="no usable run", words=HOSTILE)
        for n, one in enumerate(outcomes(3, seed=9))
    ]
    return found(groups), groups, bad


class Links(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.tags: set[str] = set()
        self.ids: list[str] = []
        self.targets: list[str] = []
        self.attributes: set[str] = set()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        told = dict(attrs)
        self.attributes |= set(told)
        self.ids += [told["id"]] if told.get("id") else []  # type: ignore[list-item]
        self.targets += [told["href"]] if told.get("href") else []  # type: ignore[list-item]


def test_a_far_flight_is_apart_and_one_click_away(
    full: tuple[Findings, dict[str, tuple[Outcome, ...]], list[Outcome]],
) -> None:
    said, groups, bad = full
    assert [(one.parameters, one.keys) for one in said.apart] == [(("L_b",), (groups[HOSTILE][20].key,))]
    assert "standard errors from the others" in apart_sentence(said.apart[0], "it")
    page = campaign_page(said, groups, bad, Path())
    assert f'<a href="#f-{groups[HOSTILE][20].key}">see it</a>' in page


def test_what_strangers_named_is_harmless_and_every_link_leads_somewhere(
    full: tuple[Findings, dict[str, tuple[Outcome, ...]], list[Outcome]], tmp_path: Path
) -> None:
    said, groups, bad = full
    write_page(said, groups, bad, tmp_path / "campaign.html")
    page = (tmp_path / "campaign.html").read_text()
    assert "<script" not in page
    assert "49" not in page.split("{{ 7*7 }}")[0][-3:]
    links = Links()
    links.feed(page)
    assert "script" not in links.tags
    assert "onload" not in links.attributes
    assert len(set(links.ids)) == len(links.ids)
    inside = {one[1:] for one in links.targets if one.startswith("#")}
    assert inside <= set(links.ids)
    assert not [one for one in links.targets if not one.startswith(("#", "./"))]
    assert "prefers-color-scheme: dark" in page
    assert "no usable run: 3" in page


def test_a_campaign_without_any_fit_has_a_page(tmp_path: Path) -> None:
    bad = [msgspec.structs.replace(one, fit=None, reason="no run", words="none") for one in outcomes(2)]
    write_page(found({}), {}, bad, tmp_path / "campaign.html")
    assert "No log was fitted" in (tmp_path / "campaign.html").read_text()
