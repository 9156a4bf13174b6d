"""A sealed answer that was opened, in words: what was hidden, and who was right."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from gcs.demo.seal import OUTCOMES, Answer, Judgement, judge_folder, open_answer


def revealed(directory: Path, diagnoses: Sequence[Path] = ()) -> list[str]:
    """The answer in a vehicle's folder beside the diagnoses there and those named. Raises as `open_answer`."""
    answer = open_answer(directory)
    return revealed_words(answer, judge_folder(answer, diagnoses))


def revealed_words(answer: Answer, judgements: Sequence[Judgement]) -> list[str]:
    """What a person reads."""
    truth = answer.document
    lines = [f"hidden: {truth['hidden']}: {truth['sentence']}" if truth["level"] != "none" else truth["sentence"]]
    if truth["level"] == "below":
        lines.append(f"  in the catalogue's words: {truth['answer']}")
    if truth["level"] == "beyond":
        lines.append("  the catalogue has no entry for it: `unexplained` is the right verdict")
    shown = truth["expect"] if truth["answer"] is not None else truth["sizes"]
    if shown:
        lines.append("  " + ", ".join(f"{name} = {value:.4g}" for name, value in shown.items()))
    lines.append(f"  plant {truth['plant']}, seed {truth['seed']}, condition {truth['condition']}")
    lines.append(f"  SHA-256 {answer.sha256}")
    for one in judgements:
        lines.append(f"{one.path.name} said {_said(one)}")
        lines += [f"  {name} {said:.4g}, truth {true:.4g}{_off(said, true)}" for name, said, true in one.parameters]
    if not judgements:
        lines.append("no diagnosis lies here; name one to see it judged")
    return lines


def _said(one: Judgement) -> str:
    effect = f" {one.effect}" if one.effect is not None else ""
    return f"{one.verdict}{effect}: {OUTCOMES[one.outcome]}"


def _off(said: float, true: float) -> str:
    return f" ({100 * (said / true - 1):+.1f} %)" if true else ""
