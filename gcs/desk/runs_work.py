"""What is done with the runs of a flight before they are fitted: leave out, split, cut, look at one alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from gcs.desk import shell
from gcs.desk.desk import Desk
from gcs.desk.state import Choice, RunRow
from gcs.errors import TippathError
from gcs.logs.runs.run import FromStart, split_mark

JUDGED = (Choice.FIT, Choice.VALIDATE)


class RunsDesk(Desk):
    """A desk that cuts and splits runs. Its methods raise TippathError; those that read a log wait."""

    def use_alike(self) -> None:
        """Leave out the chosen runs that are not like the others: another vehicle, rate, gains, flight condition."""
        # scipy comes along
        from gcs.analysis.alike import alike
        from gcs.analysis.text.findings import listed_runs

        with self._lock:
            chosen = [row for row in self._state.runs if row.choice in JUDGED and row.record is not None]
            odd = alike([record for row in chosen if (record := row.named_record) is not None]).odd
            if not odd:
                raise TippathError("the chosen runs are alike: nothing is left out")
            self._use_each(dict.fromkeys(odd, Choice.OUT), f"left out: {listed_runs(odd)}")

    def alternate(self) -> None:
        """Of each axis and maneuver every second run validates; once more, the others do."""
        with self._lock:
            rows = [row for row in self._state.runs if row.usable and row.choice in JUDGED]
            kinds: dict[tuple[str | None, str], list[RunRow]] = {}
            for row in rows:
                kinds.setdefault((row.axis, row.maneuver), []).append(row)
            split = {kind: each for kind, each in kinds.items() if len(each) > 1}
            if not split:
                raise TippathError("no axis has two runs of a kind to split: H halves the marked run")
            turned = all(row.choice is JUDGED[number % 2] for each in split.values() for number, row in enumerate(each))
            chosen = {row.id: JUDGED[(n + turned) % 2] for each in split.values() for n, row in enumerate(each)}
            self._use_each(chosen, "every second run validates")

    def _use_each(self, chosen: dict[str, Choice], said: str) -> None:
        rows = self._state.runs
        self._set(runs=tuple(replace(row, choice=chosen.get(row.id, row.choice)) for row in rows), said=said)

    def halve(self, word: str) -> None:
        """The first half of a run is fitted, the second validates."""
        # scipy comes along
        from gcs.desk import windows

        with self._working("cutting"):
            at = self._place_of_run(word)
            first, second = windows.halves(self._runs[at])
            self._recut([at], at, [(first, Choice.FIT), (second, Choice.VALIDATE)])

    def cut(self, word: str, start_s: float | None = None, stop_s: float | None = None) -> None:
        """Take a run from here, or to there: s from the start of its maneuver. It counts from the next `fit`."""
        # scipy comes along
        from gcs.desk import windows

        with self._working("cutting"):
            at = self._place_of_run(word)
            row = self._state.runs[at]
            self._recut([at], at, [(windows.narrowed(self._runs[at].id, start_s, stop_s), row.choice)])

    def take_whole(self, word: str) -> None:
        """A run as it was flown, and as it was used, in the place of its parts."""
        with self._working("cutting"):
            whole = split_mark(self._runs[self._place_of_run(word)].id)[0]
            path = self._runs[self._place_of_run(word)].path
            places = [
                place
                for place, run in enumerate(self._runs)
                if run.path == path and split_mark(run.id)[0] == whole and split_mark(run.id)[1] is not None
            ]
            if not places:
                raise TippathError(f"{whole} is used whole already")
            self._recut(places, places[0], [(None, self._state.runs[places[0]].default)])

    def _recut(self, gone: Sequence[int], at: int, parts: Sequence[tuple[FromStart | None, Choice]]) -> None:
        """Parts of a run, each with what it is used for, in the place of others of its rows."""
        from gcs.desk import choices, windows  # scipy came along before

        run, row = self._runs[at], self._state.runs[at]
        self._step(row.id)
        cut = [windows.cut(run, window) for window, _ in parts]
        if len(cut) > 1 and not all(one.usable for one in cut):
            bad = next(one for one in cut if one.reasons)
            raise TippathError(f"{bad.id}: {bad.reasons[0]}; it stays whole")
        made = []
        for one, (_, choice) in zip(cut, parts, strict=True):
            (fresh,) = choices.rows_of([one], self._keeping.folder())
            used = choice if fresh.usable else Choice.OUT
            id = f"{row.id.removesuffix(run.id)}{fresh.id}"
            made.append(replace(fresh, id=id, choice=used, default=row.default, start_s=row.start_s))
        with self._lock:
            rows, runs = list(self._state.runs), list(self._runs)
            for place in sorted(gone, reverse=True):
                del rows[place], runs[place]
            rows[at:at], runs[at:at] = made, cut
            self._runs = tuple(runs)
            unusable = [f"{one.id}: {one.reasons[0]}" for one in made if one.reasons]
            self._set(runs=tuple(rows), said="; ".join(unusable) or f"used: {', '.join(one.id for one in made)}")

    def _place_of_run(self, word: str) -> int:
        places = [place for place, row in enumerate(self._state.runs) if word == row.word]
        if len(places) != 1:
            raise TippathError(f"{word}: no such run")
        if self._state.runs[places[0]].choice is Choice.NOISE:
            raise TippathError(f"{self._state.runs[places[0]].id} is quiet hover: it tells the noise as it is")
        return places[0]

    def fit_alone(self, word: str) -> None:
        """One run's own axis, fitted to it alone: what its data say by themselves. Nothing is kept."""
        with self._working("fitting one axis"):
            row = self._state.runs[self._place_of_run(word)]
            if row.record is None or not row.usable or row.axis is None:
                raise TippathError(f"{row.id}: not usable, or of no axis that is known")
            self._step(row.id)
            said = self._calculations.alone(row.record, row.axis)
            with self._lock:
                rows = self._state.runs
                self._set(runs=tuple(replace(one, alone=said) if one.word == word else one for one in rows))
            self._did(shell.words(["tippath", "fit", row.word, "--model", row.axis]))
