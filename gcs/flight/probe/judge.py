"""The probe's judgement: the log by itself, then signs and axes, then each axis' answer."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from gcs.flight.probe.answers import answer_findings, axis_answers
from gcs.flight.probe.axes import axes_findings
from gcs.flight.probe.fit import fit_steps
from gcs.flight.probe.log_findings import flown_findings, hover_noise, log_findings, log_rate_hz, noise_findings
from gcs.flight.probe.values import MEASURED, AxisAnswer, ProbeFinding, ProbeResult, ProbeStep, Samples


def judge_probe(
    quiet: Samples,
    steps: Sequence[ProbeStep],
    rate_hz: float | None = None,
    usual_noise: Mapping[str, float] | None = None,
) -> ProbeResult:
    """What the quiet hover and the steps say.

    `quiet` has the samples of some seconds of hover (five are enough), as `ProbeStep.samples`; `rate_hz` is the rate
    the log should have, None where that is not known; `usual_noise` the deviations of p and q of an earlier probe in
    rad/s, where there was one.
    """
    findings = [*log_findings(quiet, None, rate_hz), *noise_findings(quiet, steps, usual_noise)]
    usable = []
    for step in steps:
        trouble = [*log_findings(step.samples, step.maneuver.axis, rate_hz), *flown_findings(step)]
        findings += trouble
        if not any(finding.kind in ("no samples", "no excitation") for finding in trouble):
            usable.append(step)
    frozen = {finding.axis for finding in findings if finding.kind == "frozen"}
    answers, wrong, turn_deg = _answered(quiet, usable, tuple(name for name in MEASURED if name not in frozen))
    findings += wrong
    flown = [step.maneuver.axis for step in steps if step.maneuver.axis in answers]
    in_order = tuple(answers[axis] for axis in dict.fromkeys(flown))
    findings += [finding for answer in in_order for finding in answer_findings(answer)]
    return ProbeResult(
        findings=tuple(_once(findings)),
        answers=in_order,
        noise=hover_noise(quiet),
        rate_hz=log_rate_hz(quiet["t"]),
        turn_deg=turn_deg,
    )


def _answered(
    quiet: Samples, steps: Sequence[ProbeStep], rates: tuple[str, ...]
) -> tuple[dict[str, AxisAnswer], list[ProbeFinding], float | None]:
    """Answers by axis, what is wrong with signs and axes, and by how much they are turned, of the rates that live."""
    answers: dict[str, AxisAnswer] = {}
    findings: list[ProbeFinding] = []
    turn_deg = None
    cyclic = [step for step in steps if step.maneuver.axis != "elevator"]
    if cyclic and rates:
        fit = fit_steps(quiet, cyclic, rates)
        findings, turn_deg = axes_findings(fit)
        answers |= axis_answers(fit, cyclic, swapped=any(finding.kind == "swapped" for finding in findings))
    for step in steps:
        if step.maneuver.axis == "elevator" and "q" in rates:
            answers |= axis_answers(fit_steps(quiet, [step], ("q",)), [step], swapped=False)
    return answers, findings, turn_deg


def _once(findings: Sequence[ProbeFinding]) -> Iterator[ProbeFinding]:
    """Each kind once for an axis; the worst first."""
    seen = set()
    for finding in sorted(findings, key=lambda finding: not finding.serious):
        if (finding.kind, finding.axis) not in seen:
            seen.add((finding.kind, finding.axis))
            yield finding
