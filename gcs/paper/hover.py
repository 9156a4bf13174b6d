"""Section 4: Tables 1 to 4, Figures 4, 6 and 7, and the two sets of chirps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from gcs.analysis.band import chosen_band
from gcs.analysis.fits import split_runs
from gcs.analysis.text.fit import PAPER_MODES, PAPER_NRMSE
from gcs.cards.maneuver import TestCard
from gcs.logs import resolve_runs
from gcs.paper.printed import TABLE_1, TWO_SETS
from gcs.paper.rows import (
    PRINTED,
    errors_of,
    largest_change,
    mode_rows,
    modes_of,
    noise_floor,
    nrmse_rows,
    parameter_rows,
    run_figure,
    worst_of,
)
from gcs.paper.values import PaperFigure, PaperTable, Row
from sysid.data.dataset import Dataset, prepared
from sysid.data.record import Record
from sysid.fit.identify import identify, judge
from sysid.fit.result import Fit
from sysid.model.paper import CD, TPP, reduce_to_cd

SLOW_HZ = 3.0
"""Between the two modes."""
OF_TABLE_4 = "Table 4 flown"
"""The column of the flight whose vehicle is Table 4 exactly."""


@dataclass(frozen=True, eq=False)
class HoverFlight:
    """One hover flight: chirps that are fitted, doublets that are not, both models by the paper's criterion.

    That is the time-domain least squares of the outputs, which weighs all frequencies alike (`constant`).
    """

    records: Sequence[Record]

    @classmethod
    def read(cls, log: Path) -> HoverFlight:
        """Of its log. Raises TippathError where there is none, or no runs are in it."""
        return cls(resolve_runs([str(log)]))

    @cached_property
    def band_hz(self) -> tuple[float, float]:
        return chosen_band(self.records).hz

    @cached_property
    def chirps(self) -> Dataset:
        return prepared(split_runs(self.records)[0], self.band_hz)

    @cached_property
    def doublets(self) -> Dataset:
        return prepared(split_runs(self.records)[1], self.band_hz)

    @cached_property
    def tpp(self) -> Fit:
        return identify(TPP, self.chirps, self.doublets, self.band_hz, weights="constant")

    @cached_property
    def cd(self) -> Fit:
        return identify(CD, self.chirps, self.doublets, self.band_hz, weights="constant")

    @cached_property
    def floor(self) -> dict[str, float]:
        """NRMSE of a model that leaves nothing but noise, percent; empty where the runs do not tell."""
        return noise_floor(self.tpp, self.chirps)


# ------------------------------------------------------------------------------------------------ Table 1


def chirp_table(card: TestCard) -> PaperTable:
    """Table 1: what was flown, by the card in the flight's folder."""
    chirp = next(one for one in card.maneuvers if one.kind == "chirp")
    ours = {
        "start, Hz": chirp.f_start_hz,
        "end, Hz": chirp.f_stop_hz,
        "noise fraction": chirp.noise_fraction,
        "C_1": chirp.c1,
        "C_2": 1 / math.expm1(chirp.c1),
    }
    rows = [Row(name=name, printed=TABLE_1[name], ours=value, digits=4) for name, value in ours.items()]
    sizes = ", ".join(
        f"{one.axis} {one.repeat} x {one.duration_s:g} s at {one.amplitude:g}"
        for one in card.maneuvers
        if one.kind == "chirp"
    )
    why = (
        "No difference: these are the settings that were flown.",
        f"Not in the paper's table, and needed to fly it: length and amplitude ({sizes} of full command), and the rate "
        "at which the noise is drawn: 500 Hz, at which the low-pass leaves 0.24 of its deviation.",
    )
    return PaperTable(label="Table 1", caption="Settings of the exponential-time chirp.", rows=tuple(rows), why=why)


# ------------------------------------------------------------------------------------------------ Tables 2 to 4


def modes_table(own: HoverFlight, bare: HoverFlight) -> PaperTable:
    """Table 2."""
    rows = [
        *mode_rows("CD", own.cd.model, PAPER_MODES["cd"], {OF_TABLE_4: bare.cd.model}),
        *mode_rows("TPP", own.tpp.model, PAPER_MODES["tpp"], {OF_TABLE_4: bare.tpp.model}),
    ]
    printed = modes_of(PRINTED["TPP"])[0]
    (name, percent), (own_name, own_percent) = (
        largest_change(printed, modes_of(one.tpp.model)[0]) for one in (bare, own)
    )
    (reduced,) = reduce_to_cd(PRINTED["TPP"]).modes
    (own_cd,), (bare_cd,) = own.cd.model.modes, bare.cd.model.modes
    why = (
        f"TPP: where Table 4's own vehicle flies, the same chirps, log and fit give its eigenfrequencies to "
        f"{percent:.2f} % (poles {name}); in ours they are off by up to {own_percent:.1f} % (poles {own_name}). The "
        "two "
        "vehicles differ in what ours has beyond a tip-path plane: servos of 16 Hz, 6 ms of delay, play, dynamic "
        "inflow. "
        "The fit can put these only into the nine numbers that it has: a later and slower rotor.",
        f"CD: printed 1.54 Hz / 0.35. Fitted to Table 4's own vehicle it is {bare_cd.frequency_hz:.2f} Hz / "
        f"{bare_cd.damping_ratio:.2f}, to ours {own_cd.frequency_hz:.2f} Hz / {own_cd.damping_ratio:.2f}, and reduced "
        f"from Table 4's TPP as section 3.3 derives it {reduced.frequency_hz:.2f} Hz / {reduced.damping_ratio:.2f}. A "
        "CD has no number for the second mode: its one mode is a compromise by the criterion over all frequencies that "
        "were flown, so it moves with the chirp's amplitudes and length, which are not printed.",
    )
    return PaperTable(
        label="Table 2",
        caption="Eigenfrequencies and damping ratios of the fitted models.",
        rows=tuple(rows),
        columns=(OF_TABLE_4,),
        why=why,
    )


def nrmse_table(own: HoverFlight, bare: HoverFlight) -> PaperTable:
    """Table 3."""
    rows: list[Row] = []
    for word, runs in (("chirps", own.chirps), ("doublets", own.doublets)):
        others = bare.chirps if word == "chirps" else bare.doublets
        for label, fit, beside in (("TPP", own.tpp, bare.tpp), ("CD", own.cd, bare.cd)):
            columns = {
                "printed model, our runs": judge(PRINTED[label], runs, own.band_hz),
                OF_TABLE_4: judge(beside.model, others, bare.band_hz),
                "noise alone": own.floor if word == "chirps" else None,
            }
            ours = judge(fit.model, runs, own.band_hz)
            rows += nrmse_rows(f"{word}, {label}", ours, PAPER_NRMSE[label.lower(), word], columns)
    p, q = own.tpp.nrmse_percent["p"], own.tpp.nrmse_percent["q"]
    bare_p, bare_q = bare.tpp.nrmse_percent["p"], bare.tpp.nrmse_percent["q"]
    theirs = judge(PRINTED["CD"], own.chirps, own.band_hz)
    why = [
        f"TPP, chirps: Table 4's own vehicle reaches {bare_p:.1f} / {bare_q:.1f} %, and only gusts are left. Ours "
        f"reaches {p:.1f} / {q:.1f} %: the {bare_p - p:.1f} / {bare_q - q:.1f} points between are what it has beyond a "
        "tip-path plane. The paper flew indoors: as much of its 22 points need not be noise either.",
        f"CD: the printed one reaches {theirs['p']:.1f} / {theirs['q']:.1f} % on our chirps, one fitted to them "
        f"{own.cd.nrmse_percent['p']:.1f} / {own.cd.nrmse_percent['q']:.1f} %. Its q lies far below its p in ours as "
        "in the "
        "paper, for the second mode is almost purely pitch.",
        f"Doublets: the paper's were flown by hand, ours by the autopilot. Below {SLOW_HZ:g} Hz, where CD still "
        "follows, "
        f"lie {share_below(own.doublets.records, 'q', SLOW_HZ):.0f} % of q's power in our doublets and "
        f"{share_below(own.chirps.records, 'q', SLOW_HZ):.0f} % in our chirps. So CD's q does better on ours.",
    ]
    if own.floor:
        why.append(
            f"Gusts, and whatever else of our vehicle follows no command linearly, leave {own.floor['p']:.1f} / "
            f"{own.floor['q']:.1f} % to the best linear model (noise alone)."
        )
    return PaperTable(
        label="Table 3",
        caption="NRMSE (eq. 10), percent; 100 is perfect. Chirps are fitted, doublets are not.",
        rows=tuple(rows),
        columns=("printed model, our runs", OF_TABLE_4, "noise alone"),
        shows_percent=False,
        why=tuple(why),
    )


def share_below(records: Sequence[Record], channel: str, hz: float) -> float:
    """Of a channel's power over some runs, percent that lies below this frequency."""
    low = whole = 0.0
    for record in records:
        values = record.channels[channel] - np.mean(record.channels[channel])
        power = np.abs(np.fft.rfft(values)) ** 2
        frequency = np.fft.rfftfreq(values.size, float(np.median(np.diff(record.t))))
        low += float(np.sum(power[frequency < hz]))
        whole += float(np.sum(power))
    return 100 * low / whole


def parameter_table(own: HoverFlight, bare: HoverFlight) -> PaperTable:
    """Table 4."""
    rows: list[Row] = []
    for label, fit, beside in (("TPP", own.tpp, bare.tpp), ("CD", own.cd, bare.cd)):
        printed = PRINTED[label]
        rows += parameter_rows(
            label, fit, {name: printed[name] for name in printed.structure.names}, {OF_TABLE_4: beside}
        )
    worst, off, came = worst_of(bare.tpp, PRINTED["TPP"].by_name)
    changed = {name: abs(own.tpp.model[name] - bare.tpp.model[name]) / errors_of(own.tpp)[name] for name in TPP.names}
    most = max(changed, key=lambda one: changed[one])
    one, percent = largest_change(bare.cd.model.by_name, own.cd.model.by_name)
    why = (
        f"TPP: from Table 4's own vehicle the nine numbers {came}; the farthest, {worst}, is {off:.1f} of its standard "
        f"errors off. Ours has servos, delay, play and inflow besides, and with them {most} is {changed[most]:.0f} "
        f"standard errors away ({own.tpp.model[most]:.4g}, there {bare.tpp.model[most]:.4g}): a number of a structure "
        "that is too small is no number of the vehicle, and its standard error does not tell.",
        "CD: its eight numbers have no truth in either vehicle. What our vehicle has beyond Table 4 moves them by up "
        "to "
        f"{percent:.0f} % ({one}), and Table 4's own vehicle does not have the printed ones either: they depend on "
        "what "
        "was flown as much as on what flew.",
    )
    return PaperTable(
        label="Table 4",
        caption="Fitted values. TPP's are free of Omega; off: our value less the printed one, in standard errors.",
        rows=tuple(rows),
        columns=(OF_TABLE_4, f"{OF_TABLE_4}, off in SE"),
        why=why,
    )


# ------------------------------------------------------------------------------------------------ figures


def hover_figures(own: HoverFlight) -> list[PaperFigure]:
    """Figures 4, 6 and 7."""
    models = {"TPP": own.tpp.model, "CD": own.cd.model}
    chirps, doublets = own.chirps.records, own.doublets.records
    roll, pitch = (next(one for one in chirps if one.axis == axis) for axis in ("roll", "pitch"))
    first = [next(one for one in doublets if one.axis == axis) for axis in ("roll", "pitch")]
    drawn: Sequence[tuple[str, str, Sequence[Record]]] = (
        ("Figure 4", "First roll, then pitch doublets, not fitted; the attitude controller is on.", first),
        ("Figure 6", "Chirp on the roll axis in hover. The pitch rate is coupling.", [roll]),
        ("Figure 7", "Chirp on the pitch axis in hover. CD lacks the second mode.", [pitch]),
    )
    return [run_figure(label, caption, records, models, own.band_hz) for label, caption, records in drawn]


# ------------------------------------------------------------------------------------------------ two sets


def two_sets_table(one: HoverFlight, other: HoverFlight) -> PaperTable:
    """The largest changes of parameters, eigenfrequencies and damping ratios between two sets of chirps."""
    first, second = one.tpp.model, other.tpp.model
    parameters = largest_change(first.by_name, second.by_name)
    pairs = zip(modes_of(first), modes_of(second), strict=True)
    frequencies, dampings = (largest_change(a, b) for a, b in pairs)
    found = {"parameters": parameters, "eigenfrequencies": frequencies, "damping ratios": dampings}
    rows = [
        Row(name=f"{name} ({which})", printed=TWO_SETS[name], ours=percent, digits=2)
        for name, (which, percent) in found.items()
    ]
    name = parameters[0]
    z = {
        key: (second[key] - first[key]) / (errors_of(one.tpp)[key] ** 2 + errors_of(other.tpp)[key] ** 2) ** 0.5
        for key in first.structure.names
    }
    worst = max(z, key=lambda key: abs(z[key]))
    why = (
        f"In percent {name} changes most, {first[name]:.4g} and {second[name]:.4g}: {abs(z[name]):.1f} standard "
        "errors of "
        f"both together. In standard errors {worst} does, {abs(z[worst]):.1f}. The vehicle is the same, only gusts, "
        "noise and how its play stands differ: so much percent is the scatter of the method, and the paper's figures "
        "are of the same size.",
    )
    return PaperTable(
        label="Section 4.2, two sets",
        caption="Largest change of the TPP between two sets of chirps, percent; in brackets where.",
        rows=tuple(rows),
        shows_percent=False,
        why=why,
    )
