"""Section 6: Tables 5 and 6, Figures 8 to 10, and what a lag that no model has makes of M_q."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from gcs.analysis.fits import PAPER_PARAMETERS
from gcs.logs import resolve_runs
from gcs.paper.printed import TABLE_5, TABLE_6
from gcs.paper.rows import errors_of, noise_floor, nrmse_rows, parameter_rows, run_figure, worst_of
from gcs.paper.values import PaperFigure, PaperTable, Row
from sysid.data.dataset import Dataset, prepared
from sysid.data.preprocess import DEFAULT_BAND_HZ
from sysid.data.record import Record
from sysid.fit.identify import identify, judge
from sysid.fit.result import Fit
from sysid.model.compose import compose
from sysid.model.paper import CD, TPP
from sysid.model.structure import Model
from sysid.notebook import simulate

FITTED = 3
"""Chirps, of the card's six: roll, pitch, elevator; then the three again for validation."""
EFFECTS = ("angular_damping", "elevator")
"""Eq. 15-16 onto the TPP; the CD has the first in its own parameters."""
COMMANDS = ("delta_x", "delta_y", "delta_e")
HELD = {"L_b": PAPER_PARAMETERS["tpp"][0], "M_a": PAPER_PARAMETERS["tpp"][1]}
"""The paper held them at their values of hover, Table 4."""
LAGS_S = (0.0, 0.01, 0.02, 0.03)
TRUE_M_Q = -2.0
"""1/s, of the vehicle that is thought up to see what a lag makes of it: damping, as physics has it."""


@dataclass(frozen=True, eq=False)
class ForwardFlight:
    """The flight: three chirps that are fitted and three that are not, by the paper's criterion."""

    records: Sequence[Record]

    @classmethod
    def read(cls, log: Path) -> ForwardFlight:
        """Of its log. Raises TippathError where there is none, or no runs are in it."""
        return cls(resolve_runs([str(log)]))

    @cached_property
    def fitted(self) -> Dataset:
        return prepared(self.records[:FITTED], DEFAULT_BAND_HZ)

    @cached_property
    def validation(self) -> Dataset:
        return prepared(self.records[FITTED:], DEFAULT_BAND_HZ)

    @cached_property
    def tpp(self) -> Fit:
        """L_b and M_a held, as the paper did."""
        return self._fit(HELD)

    @cached_property
    def free(self) -> Fit:
        """Nothing held."""
        return self._fit({})

    @cached_property
    def cd(self) -> Fit:
        return identify(CD, self.fitted, self.validation, effects=EFFECTS[1:], weights="constant")

    @cached_property
    def floor(self) -> dict[str, float]:
        """NRMSE of a model that leaves nothing but noise, percent; empty where the runs do not tell."""
        return noise_floor(self.tpp, self.fitted)

    def _fit(self, fixed: dict[str, float]) -> Fit:
        return identify(TPP, self.fitted, self.validation, effects=EFFECTS, fixed=fixed, weights="constant")


def printed_model(label: str) -> Model:
    """Table 5's TPP or CD, on three commands."""
    structure = compose(label, EFFECTS if label == "tpp" else EFFECTS[1:], COMMANDS)
    return Model(structure, structure.vector(dict(TABLE_5[label])))


def parameter_table(flight: ForwardFlight) -> PaperTable:
    """Table 5."""
    tpp, cd = flight.tpp, flight.cd
    rows = [
        *parameter_rows("TPP", tpp, TABLE_5["tpp"], {"all free": flight.free}),
        *parameter_rows("CD", cd, TABLE_5["cd"], {}),
    ]
    free, (worst, off, came) = flight.free, worst_of(tpp, TABLE_5["tpp"])
    error = errors_of(free)
    low, high = TABLE_6["tpp", "fitted"][::-1]
    why = (
        f"TPP: the vehicle that flew is the printed Table 5, and its numbers {came}; the farthest, {worst}, is "
        f"{off:.1f} "
        f"standard errors off. M_q is found positive, {tpp.model['M_q']:.2f} ± {errors_of(tpp)['M_q']:.2f}, because "
        "this "
        "vehicle was given the printed value; why a real one could seem to have it stands below (section 6, M_q).",
        f"L_b and M_a were held; with all free M_a is {free.model['M_a']:.0f} ± {error['M_a']:.0f} and M_q "
        f"{free.model['M_q']:.2f} ± {error['M_q']:.2f}: three chirps tell them apart, nothing needs to be held.",
        "CD: no CD flew. Its numbers are those of the response nearest to Table 5's by the criterion, for our chirps. "
        "The "
        f"printed ones were fitted to a vehicle of which Table 5 itself explains {low:.0f} to {high:.0f} %, so the "
        "difference is that vehicle's, not the method's: the printed CD on our runs does worse (Table 6, beside).",
    )
    return PaperTable(
        label="Table 5",
        caption="Fitted values in forward flight; L_b and M_a are held at Table 4's.",
        rows=tuple(rows),
        columns=("all free", "all free, off in SE"),
        why=why,
    )


def nrmse_table(flight: ForwardFlight) -> PaperTable:
    """Table 6."""
    rows: list[Row] = []
    fits = {"tpp": flight.tpp, "cd": flight.cd}
    judged: dict[tuple[str, str], dict[str, float]] = {}
    for word, runs in (("fitted", flight.fitted), ("validation", flight.validation)):
        for label, fit in fits.items():
            ours = judged[label, word] = judge(fit.model, runs)
            columns = {"printed model, our runs": judge(printed_model(label), runs)}
            rows += nrmse_rows(f"{word}, {label.upper()}", ours, TABLE_6[label, word], columns)
    drop = {output: judged["tpp", "fitted"][output] - judged["tpp", "validation"][output] for output in ("p", "q")}
    ours, same = judged["tpp", "fitted"], judge(printed_model("tpp"), flight.fitted)
    floor = flight.floor
    noise = f" (noise alone: {floor['p']:.1f} / {floor['q']:.1f} %)" if floor else ""
    printed = [a - b for a, b in zip(TABLE_6["tpp", "fitted"], TABLE_6["tpp", "validation"], strict=True)]
    why = (
        f"TPP: ours reaches {ours['p']:.1f} / {ours['q']:.1f} %, the printed TPP on our runs {same['p']:.1f} / "
        f"{same['q']:.1f} %: it is the vehicle that flew, and what is left are its gusts{noise}. The paper's "
        f"{TABLE_6['tpp', 'fitted'][0]:.1f} / {TABLE_6['tpp', 'fitted'][1]:.1f} % are lower by what its vehicle has "
        "and "
        "eq. 15 has not; a lag of the servos alone takes a good part of that from q (section 6, M_q).",
        f"From fitted to validation ours loses {drop['p']:.1f} / {drop['q']:.1f} points, the paper {printed[0]:.1f} / "
        f"{printed[1]:.1f}. Rotor speed (1550 to 1720 RPM) and airspeed (17 to 19.5 m/s) move in both, and on our "
        "vehicle "
        "nothing depends on them. Noise would lower both rows alike; a lag would, too. So the paper's loss is of what "
        "differs between flights: those two, or what was not measured, as angle of attack. Which, its tables do not "
        "tell.",
        "CD: q lacks the second mode, as in hover. The printed CD, of another vehicle, serves our runs worse than "
        "their "
        "own.",
    )
    return PaperTable(
        label="Table 6",
        caption="NRMSE (eq. 10) in forward flight, percent; three chirps (roll, pitch, elevator) each.",
        rows=tuple(rows),
        columns=("printed model, our runs",),
        shows_percent=False,
        why=why,
    )


def forward_figures(flight: ForwardFlight) -> list[PaperFigure]:
    """Figures 8 to 10."""
    models = {"TPP": flight.tpp.model, "CD": flight.cd.model}
    captions = (
        ("Figure 8", "Validation chirp on the roll axis in forward flight."),
        ("Figure 9", "Validation chirp on the pitch axis in forward flight. At about 15 s the paper's logger dropped "
         "samples; none is missing here."),
        ("Figure 10", "Validation chirp on the elevator in forward flight. The paper's caption calls the roll rate q."),
    )  # fmt: skip
    return [
        run_figure(label, caption, [record], models, DEFAULT_BAND_HZ)
        for (label, caption), record in zip(captions, flight.validation.records, strict=True)
    ]


def lag_table(flight: ForwardFlight) -> PaperTable:
    """What the paper's fit makes of M_q where the servos lag and nobody models it: computed, on the flown commands."""
    rows = []
    for lag_s in LAGS_S:
        vehicle = _lagging(lag_s)
        runs = [_answered(record, vehicle) for record in flight.fitted.records]
        fit = identify(TPP, runs, effects=EFFECTS, fixed=HELD, weights="constant")
        rows.append(
            Row(
                name=f"M_q found, servos lag {1000 * lag_s:.0f} ms",
                printed=TABLE_5["tpp"]["M_q"],
                ours=fit.model["M_q"],
                error=errors_of(fit)["M_q"],
                beside={
                    "true": TRUE_M_Q,
                    "NRMSE p, %": fit.nrmse_percent["p"],
                    "NRMSE q, %": fit.nrmse_percent["q"],
                },
                digits=2,
            )
        )
    found = [row.ours or 0.0 for row in rows]
    first = next((lag for lag, value in zip(LAGS_S, found, strict=True) if value > 0), None)
    words = (
        f"from {1000 * first:.0f} ms of lag on the fit calls damping of {TRUE_M_Q:g} 1/s a positive feedback"
        if first is not None
        else f"no lag up to {1000 * LAGS_S[-1]:.0f} ms alone turns the sign"
    )
    why = (
        "The paper finds M_q positive, to its surprise, and suspects the angle of attack. Table 5's vehicle "
        f"with M_q = {TRUE_M_Q:g} 1/s answers the commands that were flown, without noise, its servos with a lag; the "
        f"paper's structure is fitted with L_b and M_a held: {words}. A lag of the servos is enough for the printed "
        "sign; it is not shown that it was the cause.",
    )
    return PaperTable(
        label="Section 6, M_q",
        caption="M_q where the servos lag and the model does not know, 1/s.",
        rows=tuple(rows),
        columns=("true", "NRMSE p, %", "NRMSE q, %"),
        shows_percent=False,
        ours="found",
        why=why,
    )


def _lagging(lag_s: float) -> Model:
    effects = EFFECTS if lag_s == 0 else (*EFFECTS, "servo_lag")
    structure = compose("tpp", effects, COMMANDS)
    values = {**TABLE_5["tpp"], **HELD, "M_q": TRUE_M_Q, "tau_s": lag_s}
    return Model(structure, structure.vector({name: values[name] for name in structure.names}))


def _answered(record: Record, model: Model) -> Record:
    """The run with the rates that this vehicle would have had. The log's rate is even to a microsecond."""
    t = np.linspace(record.t[0], record.t[-1], record.t.size)
    commands = {name: record.channels[name] for name in model.structure.inputs}
    return simulate(record.id, model, t, commands, maneuver=record.maneuver)
