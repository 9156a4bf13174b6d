"""What a diagnosis costs, against the base fit of the same runs: four chirps of 30 s, with a lag and with nothing."""

from __future__ import annotations

from planted import PLANTED, fly_many
from planted_fits import records
from timing import best_of, cpu_of

from sysid.data.dataset import dataset
from sysid.diagnose.diagnose import diagnose
from sysid.diagnose.evidence import candidate, instrumental_step
from sysid.diagnose.score import score
from sysid.diagnose.verdict import Diagnosis
from sysid.fit.estimate import estimate
from sysid.fit.identify import identify, on_runs
from sysid.fit.noise import divide
from sysid.fit.whitening import noise_whitening
from sysid.model.compose import compose
from sysid.model.effect import EffectError, catalogue
from sysid.model.paper import TPP


def bench_diagnosis() -> None:
    """Scores and whole diagnoses, against the base fit."""
    print()
    for effect in (None, "servo_lag", "servo_backlash"):
        (flight,) = fly_many(effect, {} if effect is None else PLANTED[effect], seeds=[3])
        flown = records(flight)
        structure = on_runs("tpp", (), flown, flown)
        base_s = best_of(5, lambda flown=flown: identify(TPP, flown))
        on = dataset(flown, (0.0, 15.0))
        parent = candidate(estimate(structure, on.viewed(structure.inputs)), (), on)
        whitening = noise_whitening(parent.model, on.stacks, divide(parent.estimate.error, on.stacks, on.causes))
        stepped = instrumental_step(parent, whitening)
        composed = []
        for one in catalogue().values():
            try:
                composed.append((one, compose("tpp", [one], on.available, dict(on.constants))))
            except EffectError:
                continue

        def ask(linear: bool, composed=composed, parent=parent, stepped=stepped, whitening=whitening) -> None:  # type: ignore[no-untyped-def]
            for one, made in composed:
                if one.linear or not linear:
                    score(one, made, parent, stepped, whitening)

        linear_s = best_of(3, lambda ask=ask: ask(True))
        all_s = best_of(3, lambda ask=ask: ask(False))
        whole_s = best_of(2, lambda structure=structure, flown=flown: diagnose(structure, flown))
        print(
            f"{effect or 'nothing'} hidden: base fit {1000 * base_s:.0f} ms; score of the linear entries "
            f"{linear_s / base_s:.0f}, of all {all_s / base_s:.0f}, whole diagnosis {whole_s / base_s:.0f} base fits "
            f"({whole_s:.1f} s)"
        )


def bench_chains() -> None:
    """A diagnosis with chains, and a second one of a fit that has what was missing, in CPU against the base fit."""
    print()
    for name, begin in {
        "a turned gyro and a lag": (),
        "a lag that the fit has": ("servo_lag",),
    }.items():
        (flight,) = fly_many("servo_lag", PLANTED["servo_lag"], seeds=[3])
        if not begin:
            flight = [{**run, "p": run["p"] + 0.2 * run["q"], "q": run["q"] - 0.2 * run["p"]} for run in flight]
        flown = records(flight)
        structure = on_runs("tpp", begin, flown, flown)
        base_s = cpu_of(5, lambda flown=flown: identify(TPP, flown))
        found: list[Diagnosis] = []
        whole_s = cpu_of(
            2, lambda structure=structure, flown=flown, found=found: found.append(diagnose(structure, flown))
        )
        last = found[-1]
        print(
            f"{name}: {last.verdict} {' + '.join(last.chain)}, {len(last.pairs)} chains fitted; "
            f"{whole_s / base_s:.0f} base fits ({whole_s:.1f} s of CPU, the better of two)"
        )
