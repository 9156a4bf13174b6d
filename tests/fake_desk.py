"""Moments of the desk without mathematics: what screens and lines need of a fit, a comparison, a diagnosis."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from planted import TABLE_4

from gcs.analysis.answer import Answer, Plan, Row
from gcs.analysis.clearance import Clearance
from gcs.analysis.standing import Standing
from gcs.analysis.text.blocks import Block, Sentence
from gcs.analysis.text.hidden import hidden_sentences
from gcs.analysis.text.maneuvers import proposal_text, why_text
from gcs.desk import Base, Choice, Designed, DeskState, Fitted, Rung, RunRow, TimedNote
from gcs.desk.state import Asked, OnFit, Present, Trial, Weights
from gcs.flight.identified import Identified
from sysid.compare.finding_kinds import ErrorInBand, NoiseKnown, NotSeparable
from sysid.compare.values import BandError, Densities, Trace
from sysid.control.judgement import Limits, judge
from sysid.control.regulator import design
from sysid.control.stability import Margins
from sysid.data.record import Record
from sysid.diagnose.hidden import CouldHide, Hidden
from sysid.diagnose.progress import Asking, Heard, Known, Ranking, Stage
from sysid.diagnose.proposals import LogSignal, SignalTells
from sysid.model.compose import compose
from sysid.model.paper import TPP
from sysid.model.parameter import Parameter
from sysid.model.structure import Model

HOME = Path("flight-0007")


def record(id: str, axis: str, **vehicle: str) -> Record:
    """A run of 12 s, its own rate the larger."""
    t = np.arange(0.0, 12.0, 0.02)
    wave = 0.1 * np.sin(4 * t)
    own, other = (4 * wave, wave) if axis == "roll" else (wave, 4 * wave)
    return Record(
        id,
        {"t": t, "p": own, "q": other, "delta_x": wave, "delta_y": 0.5 * wave, "excitation_x": 0.8 * wave},
        axis=axis,
        vehicle=vehicle,
    )


def run_row(number: int, choice: Choice, maneuver: str = "chirp", axis: str = "roll", **more: Any) -> RunRow:
    row = RunRow(
        id=f"flight.BIN#{number}", word=f"flight-0007/flight.BIN#{number}", maneuver=maneuver, axis=axis,
        duration_s=30.0, rate_hz=500.0, size=0.07, health="500 Hz, no gaps, 0.5-10 Hz", usable=True, reasons=(),
        notes=(), verdict="keep", choice=choice, default=choice,
    )  # fmt: skip
    return replace(row, **more)


RUNS = (
    run_row(1, Choice.FIT, notes=("Tischler's law, C1 4, noise 0.2",), record=record("flight.BIN#1", "roll")),
    run_row(2, Choice.OUT, verdict="fly again: gust", health="gust"),
    run_row(3, Choice.FIT, axis="pitch", record=record("flight.BIN#3", "pitch")),
    run_row(4, Choice.VALIDATE, "doublet"),
    run_row(5, Choice.OUT, usable=False, reasons=("the gyro clips at 34.9 rad/s: fly it smaller",), health="clipped"),
    run_row(6, Choice.NOISE, "quiet", axis=None, size=None),
)


def fit(*effects: str, p: float, q: float, base: str = "tpp") -> Any:
    structure = compose(base, effects)
    values = np.array([TABLE_4.get(one.name, one.typical) for one in structure.parameters])
    return SimpleNamespace(
        model=Model(structure, values), standard_errors=0.01 * np.abs(values), fixed=(), at_bound=(), undetermined=(),
        implausible=(), model_errors={}, validation=(SimpleNamespace(id="flight.BIN#4"),),
        nrmse_percent={"p": p, "q": q},
        validation_nrmse_percent={"p": p - 0.7, "q": q - 1.2},
    )  # fmt: skip


def comparison() -> Any:
    t = np.arange(0.0, 12.0, 0.01)
    p, q = np.sin(4 * t) * t / 12, 0.5 * np.cos(7 * t)
    residual = np.stack([0.05 * np.sin(30 * t), 0.1 * np.cos(20 * t)])
    commands = {"delta_x": 0.1 * np.sin(4 * t), "delta_y": 0.05 * np.cos(7 * t)}
    traces = tuple(Trace(f"flight.BIN#{n}", t, np.stack([p, q]), residual, commands) for n in (1, 3))
    f = np.geomspace(0.5, 10.0, 60)

    def response(output: str, command: str) -> Any:
        return SimpleNamespace(
            mismatch=SimpleNamespace(output=output, command=command, frequency_hz=f, coherence=np.exp(-f / 20)),
            frequency_hz=f, decibels=-f / 3, degrees=-6 * f, allowed_db=np.ones(60), allowed_deg=np.full(60, 6.0),
            noticed=((3.0, 9.0),), measured=3.0 / (1.0 + 0.3j * f),
        )  # fmt: skip

    levels = np.stack([1 / f, 1 / f], axis=1)
    bands = tuple(
        BandError(
            axis=axis,
            low_hz=low,
            high_hz=high,
            error_share=share,
            noise_share=0.2,
            coherence={"delta_x": 0.9},
            coherence_together=0.93,
        )
        for axis in ("roll", "pitch")
        for low, high, share in ((0.5, 2.0, 0.2), (2.0, 10.0, 0.8))
    )
    return SimpleNamespace(
        outputs=("p", "q"), band_hz=(0.0, 15.0), traces=traces, bands=bands,
        nrmse_percent={"p": 64.1, "q": 60.9}, noise_floor_percent={"p": 82.0, "q": 88.3},
        responses=tuple(response(o, c) for o in "pq" for c in ("delta_x", "delta_y")),
        densities=Densities(f, levels, 0.1 * levels, 0.01 * levels),
        findings=(
            ErrorInBand(
                axis="pitch", band_hz=(3.4, 7.1), error_share=0.58, noise_within=0.1, coherence={"delta_x": 0.93},
                coherence_together=0.93, noise_share=0.12, noise=NoiseKnown("quiet hover", False), distortion=None,
                mixed=False, own_runs=True,
            ),
        ),
        suspicions=(NotSeparable((), "p and q may be swapped [bold]"),),
    )  # fmt: skip


HIDDEN = Hidden(
    effect="quadratic_damping", title="quadratic damping", size={"k_p": 3.0},
    sized=(Parameter("k_p", "1/rad", "damping", null=0.0),), visible=True, shift={}, relative={"M_a": 0.005},
    modes=(), margins=None,
)  # fmt: skip


def answer(verdict: str = "missing", brief: tuple[Block, ...] = ()) -> Answer:
    return Answer(
        verdict=verdict,
        chain=() if verdict == "complete" else ("servo_lag",),
        effect="servo_lag" if verdict == "missing" else None,
        confidence=0.97,
        nrmse_percent={"p": 64.1, "q": 70.9},
        noise_floor_percent={"p": 82.0, "q": 88.3},
        candidates=(
            Row(
                effects=("servo_lag",), share=0.94, nrmse_percent={"p": 81.0, "q": 87.6},
                validation_nrmse_percent={"p": 80.2, "q": 86.9}, sizes=("tau_s = 31.2 ± 0.4 ms",),
            ),
            Row(effects=("dynamic_inflow",), share=0.9, implausible=("k_l",)),
            Row(effects=("quadratic_damping",), share=0.04),
            Row(effects=("airspeed_scaling",), share=None, not_testable="it needs airspeed"),
            Row(effects=("rotor_speed",), share=None, not_testable="omega rests"),
        ),
        brief=brief,
        full=brief,
        plan=Plan(
            separates=("servo_lag", "gyro_lag"),
            maneuver=proposal_text(LogSignal("servo")),
            why=why_text(SignalTells(7.0, same_whatever=False)),
            card='name = "next"\n',
        ),
        hiding=hidden_sentences(CouldHide((), ((HIDDEN,),))),
    )  # fmt: skip


def ranking(**more: Any) -> Asked:
    """In the middle of a question."""
    heard = Ranking()
    for news in (
        Asking(stage=Stage.NOISE, of=3),
        Asking(stage=Stage.SCORES, effects=("servo_lag",), number=2, of=3),
        Heard(effects=("servo_lag",), known=Known.SCORED, promise=900.0),
        Heard(effects=("dynamic_inflow",), known=Known.SCORED, promise=300.0),
        Asking(stage=Stage.REFITS, effects=("servo_lag",), number=1, of=2, done=0.0),
        Heard(
            effects=("servo_lag",), known=Known.REFITTED, promise=900.0, removed=0.09, avoidable=0.1,
            nrmse_percent={"p": 81.0, "q": 87.6},
        ),
        Asking(stage=Stage.REFITS, effects=("dynamic_inflow",), number=2, of=2, done=0.5),
    ):  # fmt: skip
        heard = heard.after(news)
    return Asked(fit=BOTTOM.fit, ranking=heard, **more)


MISSING = (
    Block("answer", ("missing: servo_lag  (not to be told from gyro_lag)             confidence 0.97",)),
    Block(
        "measures",
        (
            "  which is: first-order lag of the servos",
            "  removes 94 % of the avoidable error     p  64.1 →  81.0   q  70.9 →  87.6 %",
            "  tau_s = 31.2 ± 0.4 ms                   plausible: 20 to 50 ms",
            "  why: phase falls linearly up to 8 Hz on both axes while the gain falls too",
        ),
        joined=True,
    ),
    Block("beside", (Sentence("to tell servo_lag from gyro_lag: move the elevator", " ", "   ", offer="card"),)),
    Block("next", (" next: tippath add flight-0007/tpp.json servo_lag -o \\", "   flight-0007/tpp-2.json")),
    Block("in full", (" in full: the same with --explain",), joined=True),
)
COMPARED = (
    Block("title", ("TPP against flight.BIN#1, #3",)),
    Block("figures", ("  NRMSE fit, %  64.1  70.9",)),
    Block("findings", (" findings",)),
    Block("bands", ("error by band, %", "  0.5-2 Hz  20")),
)

BOTTOM = Rung(name="TPP", effect=None, fit=fit(p=64.1, q=70.9), path=HOME / "tpp.json")
COMPARED_RUNG = replace(
    BOTTOM, comparison=comparison(), comparison_text=COMPARED, noise_floor_percent={"p": 82.0, "q": 88.3}
)
ASKED = replace(COMPARED_RUNG, answer=answer(brief=MISSING))
ADDED = replace(
    COMPARED_RUNG,
    name="+ servo_lag",
    effect="servo_lag",
    fit=fit("servo_lag", p=81.0, q=87.6),
    addition_text=(
        Block("answer", ("servo_lag: the error falls",)),
        Block("ladder", ("ladder", " placebo 64.3 71.0")),
        Block("next", (" next: tippath diagnose x.json",)),
    ),
)
COMPLETE = replace(ADDED, answer=answer("complete", (Block("answer", ("complete: what is left is noise",)),)))

TABLES = "\n".join(f"row {i:3d} {'x' * 60}" for i in range(60))
FITTED: Any = Fitted(
    found=SimpleNamespace(tpp=fit(p=64.1, q=70.9), cd=fit(p=60.2, q=31.5, base="cd")),  # type: ignore[arg-type]
    tables=TABLES, runs=("flight.BIN#1", "flight.BIN#3"), validation=("flight.BIN#4",),
    warnings=("look at this " * 12,), tpp_path=HOME / "tpp.json", cd_path=HOME / "cd.json",
    commands=("tippath fit " + "flight-0007/flight.BIN#1 " * 8,),
)  # fmt: skip


def doublet(axis: str) -> Any:
    t = np.arange(-0.2, 2.0, 0.01)
    asked = np.where((t > 0) & (t < 0.5), 0.3, 0.0)
    return SimpleNamespace(
        axis=axis, asked=asked, p=0.9 * asked, q=0.1 * asked, delta_x=asked, delta_y=-asked, rise_s=0.074,
        overshoot=0.29, coupling=0.2,
    )  # fmt: skip


MODEL = Model(TPP, TPP.vector(TABLE_4))
CLEARED = Clearance(
    judgement=judge(design(MODEL), [("fit", MODEL)]),
    standing=Standing(state="complete", confidence=0.98),
    covariance=None,
)
GAINS: Any = Designed(
    text="LQR on TPP\n  K  1 2 3 4", path=HOME / "gains.json", crc=0xABCDEF, command="tippath design",
    rung="TPP + servo_lag", gains=SimpleNamespace(margins=Margins(10.4, 107.0, 0.142)),  # type: ignore[arg-type]
    clearance=CLEARED, identified=Identified(),
    following=SimpleNamespace(t=np.arange(-0.2, 2.0, 0.01), roll=doublet("roll"), pitch=doublet("pitch")),  # type: ignore[arg-type]
)  # fmt: skip

ON_FIT = OnFit(gains=GAINS.gains, judgement=CLEARED.judgement, following=GAINS.following)
PRESENT = Present(
    path=HOME / "gains-1.json", crc=0x123456, document={},
    found=replace(ON_FIT, judgement=judge(design(MODEL), [("fit", MODEL)], Limits(gain_db=60.0, overshoot=0.01))),
)  # fmt: skip
"""Of a vehicle whose margins are too low for what is asked."""

OPEN = DeskState(
    path=HOME, home=HOME, name="first day",
    notes=(TimedNote("2026-05-04T12:30:00.000+00:00", "gusty [/] after noon"),), vehicle="simulated 4.5.7", runs=RUNS,
    unread=("other.BIN: not read: it is cut short",), base=Base(), commands=("tippath ingest flight-0007",),
)  # fmt: skip
MIXED = tuple(
    replace(one, record=record(one.id, str(one.axis), frame="QUAD" if one.id.endswith("4") else "HELI"))
    for one in RUNS[:4]
)
"""Of two vehicles."""
DESKS = {
    "open": OPEN,
    "mixed": replace(OPEN, runs=(*MIXED, *RUNS[4:])),
    "fitting": replace(OPEN, busy="fitting: TPP and CD", progress=0.5),
    "fitted": replace(OPEN, fitted=FITTED, ladder=(BOTTOM,)),
    "compared": replace(OPEN, fitted=FITTED, ladder=(COMPARED_RUNG,)),
    "asking": replace(
        OPEN, fitted=FITTED, ladder=(COMPARED_RUNG,), asked=ranking(), busy="refitting with dynamic_inflow (2 of 2)",
        busy_s=3, left="about 3 s left",
    ),
    "called off": replace(OPEN, fitted=FITTED, ladder=(COMPARED_RUNG,), asked=ranking(over=True)),
    "asked": replace(OPEN, fitted=FITTED, ladder=(ASKED,)),
    "unexplained": replace(
        OPEN, fitted=FITTED, ladder=(replace(ASKED, answer=answer("unexplained", MISSING)),), card=HOME / "next.toml"
    ),
    "added": replace(OPEN, fitted=FITTED, ladder=(ASKED, ADDED)),
    "complete": replace(OPEN, fitted=FITTED, ladder=(ASKED, COMPLETE)),
    "designed": replace(OPEN, fitted=FITTED, ladder=(ASKED, COMPLETE), designed=GAINS),
    "tried": replace(
        OPEN, fitted=FITTED, ladder=(ASKED,), designed=GAINS, present=PRESENT, weights=Weights(input_cost=8.0),
        trial=Trial(fit=ASKED.fit, weights=Weights(input_cost=8.0), standing=CLEARED.standing, found=ON_FIT),
    ),
    "reported": replace(
        OPEN, fitted=FITTED, ladder=(ASKED, COMPLETE), designed=GAINS, report=HOME / "report.html",
        commands=tuple(f"tippath step-{i} flight-0007/flight.BIN#{i}" for i in range(30)),
    ),
    "unkept": replace(OPEN, fitted=FITTED, ladder=(ASKED,), unkept=("TPP", "a note")),
}  # fmt: skip


class FakeDesk:
    """Shows what it is told to show and writes down what is asked of it."""

    def __init__(self, asked: list[str]) -> None:
        self.now = DeskState()
        self.asked = asked
        self.followed = 0
        """How often gains followed the sliders; the screen does that by itself, too."""

    def follow(self) -> None:
        self.followed += 1

    def state(self) -> DeskState:
        return self.now

    def __getattr__(self, name: str) -> Any:
        def ask(*words: object) -> None:
            said = [one.name if isinstance(one, Choice) else str(one) for one in words]
            self.asked.append(" ".join(["desk", name, *said]))

        return ask
