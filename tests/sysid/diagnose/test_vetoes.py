"""What may take a name away again, and what may not: the right effect led, and something spoke against it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import planted
import pytest
from more_of_a_kind import thorough
from planted import PLANTED, Run, fly_many
from planted_fits import controlled, records
from strangers.asking import ask, ask_runs, fitted_runs
from strangers.flights import fly

from gcs.analysis.text.beyond import beyond_sentences
from gcs.analysis.text.verdict import answer
from sysid.data.airframe import Airframe
from sysid.data.record import Record
from sysid.diagnose import candidates, shares, verdict
from sysid.diagnose.candidates import SIGNIFICANT
from sysid.diagnose.confidence import UNEXPLAINED_IN_A_LOOP_RIGHT, UNEXPLAINED_RIGHT
from sysid.diagnose.diagnose import diagnose
from sysid.diagnose.likely import misfit
from sysid.diagnose.score import Score
from sysid.diagnose.shares import DOUBTFUL, EXPLAINED_IN_A_LOOP, Shares
from sysid.diagnose.terms import Entry
from sysid.diagnose.verdict import Diagnosis
from sysid.fit.identify import on_runs
from sysid.model.parameter import Parameter

SECONDS = 14.0
PITCH_ALONE = {**PLANTED["structural_mode"], "kappa_roll": 0.0, "kappa_pitch": 0.06}


LATE = ("motor_lag", "servo_second_order", "gyro_filter", "transport_delay")
EXCITATIONS = ("excitation_x", "excitation_y", "excitation_e")

GIVING_LINKS = 4046836
"""Links that give, which no entry is: a saturation explains them by power, and three quarters by the noise."""
POWER_IN_A_LOOP = 4066036
"""Power that fades, in a loop whose excitation nobody logged: a drift of the hover leaves an eighth of it."""
CUBIC_POWER, PRODUCT = 4065460, 4059806
"""Links that give, whose excitation nobody logged, and a product of rates, where it is."""
GIVING_A_TENTH = 4390100
"""Where it is: a tenth of the command at its usual size, named a limit at 0.99."""
YAWING, COLLECTIVE_AND_INFLOW = 4071106, 4059914


def asked(runs: list[Run], validation: Sequence[Run] = (), without: Sequence[str] = ()) -> Diagnosis:
    flight = records(runs, *without)
    return diagnose(on_runs("tpp", (), flight, flight), flight, records(validation, *without), chains=False)


def test_a_value_is_implausible_where_all_that_physics_allows_is_beyond_two_standard_errors() -> None:
    share = Parameter("kappa", "-", "share", plausible=(0.0, 0.7), null=0.0)
    assert share.implausible(-0.026)
    assert not share.implausible(-0.026, 0.041)
    assert share.implausible(-0.026, 0.012)
    assert not share.implausible(0.75, 0.03)
    assert share.implausible(0.77, 0.03)
    assert not share.implausible(-5.0, math.inf)


@cache
def bending() -> list[list[Run]]:
    return fly_many("structural_mode", PITCH_ALONE, seeds=[31, 33], duration_s=SECONDS)


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("structural_mode", "servo_lag")], indirect=True)
@pytest.mark.parametrize("number", [0, pytest.param(1, marks=pytest.mark.thorough)])
def test_a_mode_that_roll_does_not_show_is_named_from_pitch(number: int) -> None:
    """Its share in roll is nothing within its error, and its frequency and damping there mean nothing."""
    found = asked(bending()[number])
    assert found.winner is not None
    assert found.winner.implausible == ()
    assert (found.verdict, found.effect) == ("missing", "structural_mode")
    assert found.winner.values["kappa_roll"] == pytest.approx(0, abs=0.02)
    assert found.winner.values["frequency_pitch"] == pytest.approx(PITCH_ALONE["frequency_pitch"], rel=0.02)


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("servo_lag", "inertia_coupling")], indirect=True)
def test_rough_air_on_validation_runs_takes_no_name_away() -> None:
    """Four times the gusts: most of what the validation runs leave is air, and they can say little of a small lag."""
    lag = {"tau_s": 0.012}
    calm = fly_many("servo_lag", lag, seeds=[51], duration_s=SECONDS)[0]
    rough = fly_many("servo_lag", lag, seeds=[52], duration_s=8.0, gusts=4.0)[0][:2]
    found = asked(calm, rough)
    assert (found.verdict, found.effect) == ("missing", "servo_lag")


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("servo_lag", "inertia_coupling")], indirect=True)
def test_what_leaves_noise_alone_on_validation_runs_explains_all_that_can_be_told_there() -> None:
    """A small effect in doubled gusts: by power, chance alone makes its share there a quarter."""
    lag = {"tau_s": 0.006}
    calm = fly_many("servo_lag", lag, seeds=[51], duration_s=SECONDS, gusts=0.5)[0]
    rough = fly_many("servo_lag", lag, seeds=[52], duration_s=8.0, gusts=2.0)[0][:2]
    found = asked(calm, rough)
    assert (found.verdict, found.effect) == ("missing", "servo_lag")
    assert found.winner is not None
    assert found.winner.validation_share == 1.0


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("servo_lag", "inertia_coupling")], indirect=True)
def test_rough_air_hides_no_vehicle_that_lacks_the_effect() -> None:
    calm = fly_many("servo_lag", {"tau_s": 0.03}, seeds=[53], duration_s=SECONDS)[0]
    other = fly_many(None, {}, seeds=[54], duration_s=SECONDS, gusts=3.0)[0]
    found = asked(calm, other)
    assert found.verdict == "unexplained"
    assert found.winner is not None
    assert found.winner.validation_share is not None
    assert found.winner.validation_share + found.winner.validation_slack < 0.5


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("hub_gyroscopics", "gyro_misalignment")], indirect=True)
def test_what_only_resembles_is_not_named_where_little_power_hides_how_much_it_leaves(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A product of rates and their size, which no entry is: the hub's gyroscopics explain a tenth of its evidence."""

    def with_product(*words: Any) -> planted._Equations:
        E = equations(*words)
        E.nonlinear = lambda s: {"p": 1.2 * s["q"] * np.abs(s["p"]), "q": -1.2 * s["p"] * np.abs(s["q"])}
        return E

    equations = planted.equations
    monkeypatch.setattr(planted, "equations", with_product)
    found = asked(fly_many(None, {}, seeds=[5], duration_s=SECONDS)[0])
    assert (found.verdict, found.effect, found.chain) == ("unexplained", None, ("hub_gyroscopics",))
    assert found.terms is not None
    assert found.terms.terms[0].entry.names == ("L_q_abs_p", "M_p_abs_q")
    assert "only resembles what is there" in answer(found)


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("servo_lag", "inertia_coupling")], indirect=True)
def test_what_the_loop_alone_could_make_is_no_alarm() -> None:
    """A vehicle that lacks nothing, in doubled gusts and a loop of double gain, whose excitation nobody logged."""
    with controlled(loop=2):
        runs = fly_many(None, {}, seeds=[2], duration_s=20.0, gusts=2.0)[0]
    found = asked(runs, without=EXCITATIONS)
    assert (found.verdict, found.reason) == ("complete", None)
    logged = asked(runs)
    assert logged.verdict == "complete"
    # were more left than its past foretells, by a trace of what is new, or by much of it
    left = Shares(
        least=EXPLAINED_IN_A_LOOP,
        error_share=0.1,
        noise_share=0.01,
        noise_floor_percent={},
        terms=None,
        mode=None,
        validation=None,
        new_share=0.01,
        noise_lost=False,
        latest_alone=False,
        most_explained=0.0,
        most_paid=0.0,
        paid_with=0.0,
        beside=lambda _: 0.0,
        parent=found.parent,
        whitening=found.whitening,
        term=lambda _: None,
    )
    weak, plain, strong = (math.log(chance) for chance in (1e-7, 1e-20, 1e-60))
    assert left.by_feedback(found.division, plain)
    much = replace(left, new_share=0.1)
    assert [much.by_feedback(found.division, chance) for chance in (weak, plain)] == [True, False]
    assert not left.by_feedback(found.division, strong), "that much no loop makes"
    assert not left.by_feedback(logged.division, weak)
    folded = replace(much, noise_lost=True)
    assert [folded.by_feedback(found.division, chance) for chance in (weak, plain, strong)] == [True] * 3
    assert not folded.by_feedback(logged.division, strong), "an excitation tells what the loop did"
    ringing = replace(much, latest_alone=True)
    assert ringing.by_feedback(found.division, strong)
    assert not ringing.by_feedback(logged.division, strong)
    told = replace(found, verdict="unexplained", reason="feedback")
    assert (told.to_json()["reason"], told.to_json()["instrument"]) == ("feedback", "prediction error")
    assert logged.to_json()["instrument"] == "excitation logged"
    assert "no excitation is logged" in answer(told)


@pytest.mark.thorough
@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("servo_lag", "inertia_coupling")], indirect=True)
def test_what_no_loop_could_make_has_no_such_reason() -> None:
    runs = fly_many("structural_mode", PLANTED["structural_mode"], seeds=[31], duration_s=SECONDS)[0]
    found = asked(runs, without=EXCITATIONS)
    assert (found.verdict, found.reason) == ("unexplained", None)
    assert 0.5 < found.confidence <= UNEXPLAINED_IN_A_LOOP_RIGHT
    assert 0.5 < asked(runs).confidence <= UNEXPLAINED_RIGHT


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize(
    ("only_effects", "low_hz"),
    [(LATE, 0.3), *thorough([(LATE, 1.0), (LATE, 2.0)])],
    indirect=["only_effects"],
)
def test_a_simpler_entry_is_named_before_one_whose_values_are_doubtful(shared_data: Path, low_hz: float) -> None:
    """A Crazyflie's motors lag by about 70 ms. Two real poles, which are no second-order lag, do a hair better."""
    path = shared_data / "crazyflie" / "roll_pitch_pilot_mapped.csv"
    names, *lines = path.read_text(encoding="utf-8").split()
    columns = dict(zip(names.split(","), np.loadtxt(lines, delimiter=",").T, strict=True))
    within = (columns["t"] >= 55) & (columns["t"] <= 90)
    channels = {name: columns[name][within] for name in ("t", "p", "q", "delta_x", "delta_y")}
    flight = [Record("#1", channels, airframe=Airframe.MULTIROTOR)]
    found = diagnose(on_runs("cd", (), flight, flight), flight, band_hz=(low_hz, 15.0), chains=False)
    assert (found.verdict, found.effect) == ("missing", "motor_lag")
    assert "servo_second_order" in found.not_told
    assert found.winner is not None
    assert found.winner.values["tau_m"] == pytest.approx(0.075, abs=0.0125)


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize(
    ("only_effects", "seed"),
    [(("servo_saturation",), GIVING_LINKS), (("speed_stability",), POWER_IN_A_LOOP)],
    indirect=["only_effects"],
)
def test_what_leaves_much_by_the_noise_is_not_named_by_powers(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    runs = fitted_runs(fly(seed))
    found = ask_runs(runs)
    assert (found.verdict, found.effect, found.outdone) == ("unexplained", None, True)
    assert found.explained_share is not None
    assert found.explained_share > 0.9
    assert answer(found).endswith("more likely only resembles what is there")
    monkeypatch.setattr(shares, "EXPLAINED_BY_NOISE", 0.7)
    monkeypatch.setattr(shares, "MORE_BY_A_TERM", math.inf)
    monkeypatch.setattr(shares, "OF_A_BEND", math.inf)
    by_powers = ask_runs(runs)
    assert (by_powers.verdict, by_powers.chain) == ("missing", found.chain)


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize(
    ("only_effects", "seed", "equation", "said"),
    [
        (
            ("servo_saturation",),
            CUBIC_POWER,
            "delta_x += X_delta_x3 delta_x^3, delta_y += Y_delta_y3 delta_y^3",
            "feedback alone could make what is left: log the excitation",
        ),
        (
            ("servo_saturation",),
            GIVING_A_TENTH,
            "delta_x += X_delta_x3 delta_x^3, delta_y += Y_delta_y3 delta_y^3",
            "more likely only resembles what is there",
        ),
        (
            ("hub_gyroscopics",),
            PRODUCT,
            "p_dot += L_q_abs_p q|p|, q_dot += M_p_abs_q p|q|",
            "more likely only resembles what is there",
        ),
    ],
    indirect=["only_effects"],
)
def test_what_a_simple_term_explains_far_better_is_not_named(
    seed: int, equation: str, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs = fitted_runs(fly(seed))
    found = ask_runs(runs)
    assert (found.verdict, found.effect, found.outdone) == ("unexplained", None, True)
    assert found.term is not None
    assert found.term.entry.equation == equation
    assert found.to_json()["term_ahead"]["equation"] == equation
    assert answer(found).endswith(said)
    (told,) = beyond_sentences(found)
    assert told.startswith(f"a simple term alone does more than {found.chain[0]}: {equation}")
    monkeypatch.setattr(shares, "MORE_BY_A_TERM", math.inf)
    monkeypatch.setattr(shares, "OF_A_BEND", math.inf)
    without = ask_runs(runs)
    assert (without.verdict, without.chain, without.term) == ("missing", found.chain, None)


LIMITED_ON_ONE_SIDE = 4190556
"""A judged one, 25 times what is detectable: a square of each command explained more by its score than the limit."""


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("servo_saturation",)], indirect=True)
def test_a_square_takes_no_name_away_from_a_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    runs = fitted_runs(fly(LIMITED_ON_ONE_SIDE))
    found = ask_runs(runs)
    assert (found.verdict, found.effect, found.term) == ("missing", "servo_saturation", None)
    monkeypatch.setattr(Entry, "bends", True)
    assert ask_runs(runs).term is not None


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize(
    ("only_effects", "seed", "without", "term"),
    [
        (("yaw_coupling",), YAWING, ("BESIDE_IT", "OF_IT_BESIDE"), ("L_q_r", "M_p_r")),
        (("input_coupling",), COLLECTIVE_AND_INFLOW, ("OF_IT_BESIDE",), ("L_delta_c1", "M_delta_c1")),
    ],
    indirect=["only_effects"],
)
def test_a_term_that_says_the_same_takes_no_name_away(
    seed: int, without: tuple[str, ...], term: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """What yaw or collective moves takes up more by its score than by what is foretold where the chirp shows."""
    runs = fitted_runs(fly(seed))
    found = ask_runs(runs)
    assert (found.verdict, found.chain, found.term) == ("missing", fly(seed).hidden.names[:1], None)
    for name in without:
        monkeypatch.setattr(shares, name, 0.0)
    taken = ask_runs(runs)
    assert taken.verdict == "unexplained"
    assert taken.term is not None
    assert taken.term.entry.names == term


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("seed", "where", "name", "before"),
    [
        (4065475, verdict, "NAMED_IN_A_LOOP", 0.55),
        (4059864, shares, "NEARLY_ALL", 2.0),
        (4070864, shares, "BY_NOISE_IN_A_LOOP", 0.92),
    ],
)
def test_in_a_loop_is_named_what_is_near_others_or_leaves_much_by_power_or_some_by_noise(
    seed: int, where: Any, name: str, before: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    flight = fly(seed)
    found = ask(flight).first
    assert (found.verdict, found.effect) == ("missing", flight.hidden.names[0])
    monkeypatch.setattr(where, name, before)
    unsure = ask(flight).first
    assert (unsure.verdict, unsure.chain) == ("unexplained", found.chain)


IN_BURSTS, NOTHING_BY_CHANCE = 4076956, 4077046
"""Judged ones: what collective and yaw do, in bursts of gusts and in others, 1.6 and 2.2 times what is detectable."""


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("input_coupling",)], indirect=True)
def test_what_windows_seem_to_show_in_bursts_takes_no_name_away(monkeypatch: pytest.MonkeyPatch) -> None:
    """A short chirp passes some windows in a burst: beside the right effect they showed more than it explains."""
    runs = fitted_runs(fly(IN_BURSTS))
    found = ask_runs(runs)
    assert (found.verdict, found.effect) == ("missing", "input_coupling")
    assert found.winner is not None
    assert misfit(found.winner) > found.winner.chi_squared
    monkeypatch.setattr(Shares, "_beyond_noise", lambda _, one, chance: misfit(one, chance))
    assert ask_runs(runs).verdict == "unexplained"


@pytest.mark.parametrize("rough", [True, False])
def test_what_windows_seem_to_show_in_bursts_is_no_alarm_and_is_looked_for_beside_an_effect(rough: bool) -> None:
    """What a dead band and a drift left beside play showed in windows alone, in bursts: no chain was begun."""
    division = SimpleNamespace(chi_squared=200.0, degrees=40, measured=True)
    stepped = SimpleNamespace(envelope=lambda _: SimpleNamespace(rough=rough))
    parent = cast("Any", SimpleNamespace(division=division, stepped=stepped, metric=None))
    faint = Score(effect="speed_stability", chi_squared=12.0, degrees=2, tried=1, at={}, errors={})
    assert candidates.chance_of_noise(cast("Any", division), [faint]) < SIGNIFICANT
    assert (candidates.chance_of_an_alarm(parent, [faint]) < SIGNIFICANT) == (not rough)
    surely = replace(faint, chi_squared=60.0)
    assert candidates.chance_of_an_alarm(parent, [surely]) < SIGNIFICANT, "an entry shows it, too"


@pytest.mark.parametrize(("by_windows", "alarm"), [(93.0, False), (140.0, True)])
def test_what_windows_alone_show_faintly_is_no_alarm(by_windows: float, alarm: bool) -> None:
    """Two clean judged flights in slow gusts and by chirps of 8 s showed as much by them, and by no entry."""
    division = SimpleNamespace(chi_squared=by_windows, degrees=40, measured=True)
    stepped = SimpleNamespace(envelope=lambda _: SimpleNamespace(rough=False))
    parent = cast("Any", SimpleNamespace(division=division, stepped=stepped, metric=None))
    none = Score(effect="speed_stability", chi_squared=4.0, degrees=2, tried=1, at={}, errors={})
    assert candidates.chance_of_noise(cast("Any", division), [none]) < SIGNIFICANT
    assert (candidates.chance_of_an_alarm(parent, [none]) < SIGNIFICANT) is alarm
    assert candidates.chance_of_an_alarm(parent, [replace(none, chi_squared=60.0)]) < SIGNIFICANT


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("input_coupling",)], indirect=True)
def test_what_a_simple_term_explains_by_chance_takes_no_name_away(monkeypatch: pytest.MonkeyPatch) -> None:
    runs = fitted_runs(fly(NOTHING_BY_CHANCE))
    assert ask_runs(runs).effect == "input_coupling"
    monkeypatch.setattr(shares, "TERM_TAKES", 0.0)
    assert ask_runs(runs).verdict == "unexplained"


@pytest.mark.parametrize("share", [0.99 * DOUBTFUL, 1.01 * DOUBTFUL])
def test_no_terms_are_looked_for_beside_what_is_no_answer_either_way(share: float) -> None:
    """In bursts they are dear, and only make what it leaves less: of a candidate that others leave far behind, nothing
    is told by that."""
    asked: list[object] = []
    rough = SimpleNamespace(envelope=lambda _: SimpleNamespace(rough=True))
    division = SimpleNamespace(chi_squared=500.0, degrees=40, measured=True)
    one: Any = SimpleNamespace(chi_squared=100 * share, added=0, stepped=rough, fit=SimpleNamespace(division=division))

    def beside(fit: object) -> float:
        asked.append(fit)
        return 0.0

    left: Any = object.__new__(Shares)
    for name, value in (("most_explained", 100.0), ("whitening", None), ("beside", beside)):
        object.__setattr__(left, name, value)
    assert left._by_the_noise(one) < share + 1e-9
    assert bool(asked) == (share > DOUBTFUL)
