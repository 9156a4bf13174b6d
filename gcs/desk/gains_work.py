"""Gains on the desk: sliders, a design that is kept, what the vehicle holds, and both over flights.

While sliders move, margins and answer on the fit follow them at once; a judgement over the fit's bounds takes seconds,
and comes when they rest.
"""

from __future__ import annotations

import threading
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gcs.desk import shell
from gcs.desk.keeping import ToKeep, document_text
from gcs.desk.runs_work import RunsDesk
from gcs.desk.state import Choice, Designed, Weights
from gcs.errors import TippathError, UsageError

if TYPE_CHECKING:
    from gcs.analysis.standing import Standing
    from sysid.fit.result import Fit


class GainsDesk(RunsDesk):
    """A desk on which gains are designed. Its methods raise TippathError; all but `turn` wait."""

    def __init__(self, **told: Any) -> None:
        """As `Desk`."""
        super().__init__(**told)
        self._tuning = threading.Lock()
        self._known: tuple[Fit, object, Standing] | None = None

    def open(self, word: str, *more: str, wait: bool = False) -> None:
        """As a desk opens; and the gains that were designed there, and those that were flown, where any were."""
        from gcs.desk import tuning  # scipy comes along

        before = self._state.designed
        super().open(word, *more, wait=wait)
        logs = {run.path for run in self._runs if run.path}
        first = None if before is None else before.path
        home = self._state.home
        if home is None or (first is None and not tuning.kept_gains(home)):
            return
        self._restore_gains(home)
        for path in sorted(logs, reverse=True):
            crc = tuning.flown_crc(Path(path))
            if crc is not None:
                self._set(present=tuning.present(home, crc, first))
                return

    def _restore_gains(self, home: Path) -> None:
        """The newest gains in a folder that were designed on the ladder, or on the TPP beside it."""
        from gcs.desk import tuning

        fitted = self._state.fitted
        fits = [rung.fit for rung in reversed(self._state.ladder)]
        found = tuning.designed_before(home, [*fits, *([] if fitted is None else [fitted.found.tpp])]) if fits else None
        if found is None:
            return
        made, fit = found
        assert made.path is not None
        words = shell.design(fit, self._place(fit), tuning.options(made.weights), made.path)
        with self._lock:
            if self._state.designed is None:
                self._set(designed=replace(made, command=words), weights=made.weights)

    def seek_present(self, crc: int) -> None:
        """The gains that the vehicle holds, by their checksum, among those that are kept near this flight."""
        from gcs.desk import tuning

        designed, home = self._state.designed, self._state.home
        if home is not None:
            self._set(present=tuning.present(home, crc, None if designed is None else designed.path))
            self.follow()

    # ---------------------------------------------------------------------------------------------- sliders

    def turn(self, weights: Weights) -> None:
        """Move sliders; `follow` works out what that makes."""
        self._set(weights=weights)

    def follow(self) -> None:
        """Gains for where the sliders stand, and those that the vehicle holds, on the fit; the newest wish counts."""
        from gcs.desk import tuning

        while self._to_follow() and self._tuning.acquire(blocking=False):
            try:
                fit, weights = self._to_design_on(), self._state.weights
                known = self._standing(fit)
                if not self._tried(fit):
                    records = () if weights.observer else self._flown(fit)[0]
                    self._set(trial=tuning.trial(fit, weights, known, records))
                held = self._state.present
                if held is not None and held.fit is not fit:
                    try:
                        self._set(present=tuning.present_on(held, fit, known))
                    except TippathError as error:
                        self._set(present=replace(held, fit=fit), said=str(error))
            finally:
                self._tuning.release()

    def _to_follow(self) -> bool:
        fit, held = self._to_design_on(), self._state.present
        return not self._tried(fit) or (held is not None and held.fit is not fit)

    def _tried(self, fit: Fit) -> bool:
        """Whether the trial is of this fit, of all that is known of it, and of where the sliders stand."""
        trial = self._state.trial
        return (
            trial is not None
            and trial.fit is fit
            and trial.weights == self._state.weights
            and trial.standing is self._standing(fit)
        )

    def _standing(self, fit: Fit) -> Standing:
        """What is known of a fit, once for each diagnosis."""
        from gcs.desk import tuning

        asked = next((rung.diagnosis for rung in self._state.ladder if rung.fit is fit), None)
        known = self._known
        if known is None or known[0] is not fit or known[1] is not asked:
            known = self._known = fit, asked, tuning.standing(fit, asked, self._keeping.folder().path)
        return known[2]

    def judge_trial(self) -> None:
        """What the sliders' gains are worth over the fit's bounds and on every model that is left open."""
        from gcs.desk import tuning

        self.follow()
        trial = self._state.trial
        if trial is None or trial.found is None or trial.clearance is not None or trial.found.following is None:
            return
        cleared = tuning.judged(trial.found.gains, trial.fit, self._standing(trial.fit))
        with self._lock:
            if self._state.trial is trial:
                self._set(trial=replace(trial, clearance=cleared))

    def design(self, input_cost: float | None = None) -> None:
        """LQR gains as the sliders stand on the current rung (on the fitted TPP where the ladder is of CD), kept as
        GAINS.json; `input_cost` moves its slider first."""
        if input_cost is not None:
            if not 0 < input_cost < float("inf"):
                raise UsageError("the input cost wants a positive number; the paper's is 5")
            self.turn(replace(self._state.weights, input_cost=input_cost))
        with self._working("designing gains"):
            from gcs.desk import tuning

            fit, weights = self._to_design_on(), self._state.weights
            read = self._calculations.as_read(fit, self._places.get(fit))
            self._step("")
            trial = self._state.trial if self._tried(fit) and read is fit else None
            self._known = None  # a diagnosis may have come beside the fit meanwhile
            records = () if weights.observer else self._flown(fit)[0]
            made = tuning.designed(read, weights, self._standing(fit), records, trial)
            self._step("")
            made = replace(made, rung=self._calculations.full_name(fit))
            self._set(designed=made, said="gains designed")
            self._keep_gains(fit, made)

    def _keep_gains(self, fit: Fit, made: Designed) -> None:
        from gcs.desk import tuning

        def command(path: Path) -> str:
            words = shell.design(fit, self._place(fit), tuning.options(made.weights), path)
            with self._lock:
                if self._state.designed is made:
                    self._set(designed=replace(made, path=path, command=words))
            return words

        self._keeping.keep_file(
            ToKeep(
                what="gains",
                name=lambda: "gains.json",
                text=lambda folder: document_text(made.document(folder)),
                command=command,
                did=f"designed gains on {made.rung}",
            )
        )

    # ---------------------------------------------------------------------------------------------- over flights

    def shadow(self) -> None:
        """The designed gains over the chosen runs, without authority: cleared, refused or not measured."""
        from gcs.desk import tuning

        with self._working("the shadow over the chosen runs"):
            made = self._state.designed
            if made is None or made.path is None:
                raise TippathError("no gains are kept yet: D designs them")
            rows = [row for row in self._state.runs if row.choice in (Choice.FIT, Choice.VALIDATE)]
            records = self._records(Choice.FIT) + self._records(Choice.VALIDATE)
            if not records:
                raise TippathError("no run is chosen: 3, then F or V on a run")
            self._step(f"{len(records)} runs")
            found = tuning.shadow(made, records)
            self._step("")
            with self._lock:
                now = self._state.designed
                if now is not None and now.crc == made.crc:
                    self._set(designed=replace(now, shadow=found), said=f"shadow: {found.verdict}")
            self._did(shell.words(["tippath", "shadow", made.path, *(row.word for row in rows)]))
            self._keeping.audit(f"shadow of {made.path.name} over {len(records)} runs: {found.verdict}")

    def prove(self) -> None:
        """This flight against what its gains promised: the proof after the card `proof`."""
        from gcs.analysis.proof import prove_flights

        with self._working("flown against predicted"):
            logs = [Path(path) for path in dict.fromkeys(run.path for run in self._runs if run.path)]
            if not logs:
                raise TippathError("no flight yet: 3, then O opens the one with the card `proof`")
            held, made = self._state.present, self._state.designed
            gains = held.path if held is not None else None if made is None else made.path
            if gains is None:
                raise TippathError("nothing is known of gains that flew: fly the card `proof` with pushed gains first")
            self._step(gains.name)
            found = prove_flights(gains, logs)
            self._step("")
            self._set(proof=found, said=f"{found.proof.verdict}: {len(found.proof.runs)} runs against {found.model}")
            self._did(shell.words(["tippath", "proof", gains, *logs]))
            self._keeping.audit(f"flown against predicted with {gains.name}: {found.proof.verdict}")
