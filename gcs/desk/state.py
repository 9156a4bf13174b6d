"""What the desk holds of one flight: one immutable value, replaced whole, read by whoever shows it.

In the order of the work: the runs and what each is used for, the fits, the ladder of rungs with what was compared and
asked on each, the gains with the response they promise, the report; and the shell commands that do the same again.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gcs.analysis.text.blocks import Blocks
from sysid.data.airframe import Airframe
from sysid.diagnose.progress import Ranking
from sysid.model.bases import DEFAULT

if TYPE_CHECKING:  # they bring scipy and control along, which takes a second
    from gcs.analysis.addition import Addition, Sign
    from gcs.analysis.answer import Answer
    from gcs.analysis.clearance import Clearance
    from gcs.analysis.diagnosis import FitDiagnosis
    from gcs.analysis.fits import Identification
    from gcs.analysis.proof import FlownProof
    from gcs.analysis.shadow import ShadowFlight
    from gcs.analysis.standing import Standing
    from gcs.flight.identified import Identified
    from sysid.compare.values import Comparison
    from sysid.control.judgement import Judgement
    from sysid.control.loop import Following
    from sysid.control.regulator import Gains
    from sysid.data.record import Record
    from sysid.fit.result import Fit

Nrmse = Mapping[str, float]
"""Percent by output, `p` and `q`; 100 is perfect."""


class Choice(Enum):
    """What a run is used for."""

    FIT = "fit"
    VALIDATE = "validate"
    OUT = "leave out"
    NOISE = "noise"
    """Quiet hover: it tells the noise, never enters a fit, and the user cannot choose it nor away from it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunRow:
    """One run of the flight."""

    id: str
    """`flight.BIN#2`, behind its folder where another log has that name; what `Desk.use` takes."""
    word: str
    """As a command names it: the log's path and the number."""
    maneuver: str
    """`chirp`, `doublet`, `quiet` or `unknown`."""
    axis: str | None
    duration_s: float
    rate_hz: float | None
    size: float | None
    """Root mean square of the excitation, or of the command where it is not logged; -1..1."""
    health: str
    """In few words: `500 Hz, no gaps, 0.5-10 Hz`, or the first reason against it."""
    usable: bool
    """Whether it may be chosen at all."""
    reasons: tuple[str, ...]
    """What is against it, and what to do."""
    notes: tuple[str, ...]
    verdict: str
    """Of whoever flew it: `keep`, `fly again: ...`; empty where nobody judged."""
    choice: Choice
    default: Choice
    """What the desk chose by itself."""
    start_s: float = 0.0
    """Of the maneuver as it was flown, in the log's own time: what windows count from."""
    record: Record | None = field(default=None, compare=False, repr=False)
    """To be drawn; None where there are no samples."""
    alone: tuple[str, ...] = ()
    """What a fit of this run's axis to this run says; empty where nobody asked."""

    @property
    def named_record(self) -> Record | None:
        """Its samples under this row's name: several logs may have runs of one."""
        record = self.record
        return record if record is None or record.id == self.id else replace(record, id=self.id)


@dataclass(frozen=True, slots=True)
class TimedNote:
    """What somebody wrote down."""

    time: str
    """ISO 8601, UTC."""
    text: str


@dataclass(frozen=True, slots=True)
class Base:
    """Where the ladder begins."""

    model: str = DEFAULT
    """`tpp` or `cd`."""
    effects: tuple[str, ...] = ()
    """Catalogue ids, in order; in forward flight `angular_damping`, `elevator`."""

    @property
    def words(self) -> str:
        """`tpp + elevator`."""
        return " + ".join((self.model, *self.effects))


@dataclass(frozen=True, eq=False, slots=True, kw_only=True)
class Fitted:
    """TPP, CD and the CD that the TPP reduces to, on the same runs."""

    found: Identification
    tables: str
    """NRMSE beside the paper's, modes, eigenfrequency check, parameters; 78 columns."""
    runs: tuple[str, ...]
    """Ids of those fitted,"""
    validation: tuple[str, ...]
    """and of those that judged."""
    warnings: tuple[str, ...]
    tpp_path: Path | None
    """The kept FIT.json; None where it could not be kept."""
    cd_path: Path | None
    commands: tuple[str, ...]


@dataclass(frozen=True, eq=False, slots=True, kw_only=True)
class Rung:
    """One step of the ladder: a fit, and what was asked of it."""

    name: str
    """`TPP`, `+ servo_lag`."""
    effect: str | None
    """That this rung added; None at the bottom."""
    fit: Fit
    path: Path | None
    """The kept FIT.json; None where it could not be kept."""
    noise_floor_percent: Nrmse | None = None
    """NRMSE that a model which leaves nothing but noise would reach; None until compared, asked or added."""
    addition: Addition | None = None
    """With signs and placebo; None at the bottom, and of rungs from an earlier session."""
    addition_text: Blocks = ()
    comparison: Comparison | None = None
    """With traces, responses and densities to be drawn."""
    comparison_text: Blocks = ()
    answer: Answer | None = None
    """What was answered when it was asked what this rung lacks, in this session or in an earlier one;"""
    diagnosis: FitDiagnosis | None = None
    """in this one with all that it stands on."""

    @property
    def nrmse_percent(self) -> Nrmse:
        return self.fit.nrmse_percent

    @property
    def validation_nrmse_percent(self) -> Nrmse | None:
        return self.fit.validation_nrmse_percent

    @property
    def verdict(self) -> str | None:
        """`complete`, `missing` or `unexplained`; None where it was not asked."""
        return None if self.answer is None else self.answer.verdict

    @property
    def signs(self) -> tuple[Sign, ...]:
        """Whether the effect is really there; empty where it was not added here."""
        return () if self.addition is None else self.addition.signs

    @property
    def placebo(self) -> tuple[str, Nrmse, Nrmse | None] | None:
        """The best wrong effect in this one's place: name, NRMSE fitted and on validation runs."""
        return None if self.addition is None else self.addition.placebo_rung


@dataclass(frozen=True, slots=True, kw_only=True)
class Weights:
    """What gains are designed with, as sliders have it; the paper's unless they are moved."""

    input_cost: float = 5.0
    flapping_cost: float = 0.001
    observer: float = 1.0
    """Speed of its poles over the paper's; 0 is the Kalman filter for the noise of the fit's runs."""
    dynamic: bool = False
    """Whether the prefilter leaves the other axis alone on the way, too."""


@dataclass(frozen=True, eq=False, slots=True, kw_only=True)
class OnFit:
    """Gains on the fit under the ladder's cursor: margins and answer at once, without its bounds."""

    gains: Gains
    judgement: Judgement
    """On the fit and on what completes it."""
    following: Following | None
    """None where the gains do not hold it."""


@dataclass(frozen=True, eq=False, slots=True, kw_only=True)
class Trial:
    """What the sliders would make; kept nowhere."""

    fit: Fit
    weights: Weights
    standing: Standing
    """What was known of the fit's lacks."""
    found: OnFit | None
    """None where there are no such gains:"""
    problem: str = ""
    """why."""
    clearance: Clearance | None = None
    """Over the fit's bounds, too: once the sliders rest."""


@dataclass(frozen=True, eq=False, slots=True, kw_only=True)
class Present:
    """Gains that the vehicle holds, or that were flown."""

    path: Path
    crc: int
    document: Mapping[str, Any]
    found: OnFit | None = None
    """In the loop with the fit under the ladder's cursor, or with the model that they were designed on where nothing is
    fitted yet; None where that cannot be had."""
    fit: Fit | None = None
    """That they were looked at on."""


@dataclass(frozen=True, eq=False, slots=True, kw_only=True)
class Designed:
    """Gains, and what they promise."""

    text: str
    path: Path | None
    """The kept GAINS.json; None where it could not be kept. Only a kept one is pushed."""
    crc: int
    """Of the set as the vehicle will hold it."""
    command: str
    rung: str
    """The model they were designed on, in full: `TPP + servo_lag`."""
    gains: Gains
    """With `K`, `margins`, `poles`."""
    clearance: Clearance
    """What they are worth on all that the fit's diagnosis and bounds leave open: shown, and asked again at a push."""
    identified: Identified
    """What the fit's logs tell of the vehicle: compared at a push."""
    following: Following
    """The closed loop's predicted answer to the rate doublet of the card `lqr-doublet`, for each axis."""
    weights: Weights = Weights()
    shadow: ShadowFlight | None = None
    """Over the chosen runs, without authority; None until asked."""

    def document(self, folder: Path) -> dict[str, Any]:
        """As it is kept in a folder."""
        from gcs.analysis.clearance import gains_document  # scipy comes along

        return gains_document(self.gains, self.clearance, self.identified, folder)

    @property
    def cleared(self) -> bool:
        """Whether they may be pushed without saying why."""
        return not self.clearance.judgement.refused


@dataclass(frozen=True, eq=False, slots=True, kw_only=True)
class Asked:
    """A question under way, or one that was called off: how the candidates stand so far, which is no verdict."""

    fit: Fit
    ranking: Ranking
    over: bool = False
    """Whether it was called off."""


@dataclass(frozen=True, eq=False, slots=True, kw_only=True)
class DeskState:
    """One moment."""

    path: Path | None = None
    """The flight folder or log that is open."""
    beside: tuple[Path, ...] = ()
    """Further ones that were opened with it."""
    home: Path | None = None
    """Where results are kept."""
    name: str = ""
    notes: tuple[TimedNote, ...] = ()
    vehicle: str = ""
    """What flew, in few words; empty where the folder does not tell."""
    runs: tuple[RunRow, ...] = ()
    unread: tuple[str, ...] = ()
    """Logs that could not be read, damage, kept fits that were not opened: each with why."""
    base: Base = Base()
    fitted: Fitted | None = None
    ladder: tuple[Rung, ...] = ()
    """The current one, bottom first; the cursor is on the last rung."""
    asked: Asked | None = None
    """Of a rung without an answer."""
    designed: Designed | None = None
    weights: Weights = Weights()
    """Where the sliders stand."""
    trial: Trial | None = None
    """Of where they stood last."""
    present: Present | None = None
    proof: FlownProof | None = None
    """Of this flight, flown with gains: against what was predicted; None until asked."""
    card: Path | None = None
    """The last card written by `next_card`."""
    report: Path | None = None
    printed: Path | None = None
    """The same as PDF; None where nobody asked for it."""
    busy: str = ""
    """What is being worked on; empty where nothing is."""
    called_off: bool = False
    """It was called off, and ends at its next step."""
    progress: float | None = None
    """0..1; None where it cannot be told."""
    busy_s: int = 0
    """For how long, in whole seconds,"""
    left: str = ""
    """and `about 5 s left`; empty where that cannot be told."""
    said: str = ""
    """The last word: what was done, and what could not be kept."""
    unkept: tuple[str, ...] = ()
    """Results on the screen that no folder holds yet; `Desk.keep_in` writes them."""
    commands: tuple[str, ...] = ()
    """What was done here, as a shell does it; newest last."""

    @property
    def of_multirotor(self) -> bool:
        """Whether a run that is fitted or judges tells that it is of one, which is neither TPP nor CD."""
        used = [run.record for run in self.runs if run.choice in (Choice.FIT, Choice.VALIDATE)]
        return any(record is not None and record.airframe is Airframe.MULTIROTOR for record in used)

    @property
    def opened(self) -> str:
        """What is open, by name; empty where nothing is."""
        return " + ".join(one.name or str(one) for one in (self.path, *self.beside) if one is not None)

    @property
    def current(self) -> Rung | None:
        """The rung under the cursor."""
        return self.ladder[-1] if self.ladder else None

    @property
    def comparison(self) -> Comparison | None:
        """Of the current rung."""
        return None if self.current is None else self.current.comparison

    @property
    def answer(self) -> Answer | None:
        """About the current rung."""
        return None if self.current is None else self.current.answer

    @property
    def ranking(self) -> Asked | None:
        """How candidates stand for the current rung, while it is asked and after that was called off."""
        asked, rung = self.asked, self.current
        if asked is None or rung is None or rung.fit is not asked.fit or rung.answer is not None:
            return None
        return asked

    @property
    def noise_floor_percent(self) -> Nrmse | None:
        """The last one told on the ladder."""
        return next((one.noise_floor_percent for one in reversed(self.ladder) if one.noise_floor_percent), None)

    def chosen(self, choice: Choice) -> tuple[RunRow, ...]:
        """The runs used for that."""
        return tuple(run for run in self.runs if run.choice is choice)
