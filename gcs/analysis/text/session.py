"""What people said of a flight, in blocks: `checklist`, `readiness`, `session notes`."""

from __future__ import annotations

from gcs.analysis.text.blocks import Block, Blocks, Line, Sentence, block
from gcs.flight.session_notes import ToldAnswer, ToldNote, ToldSession
from gcs.logs.words import printable


def session_blocks(told: ToldSession) -> Blocks:
    """A block for each of which there is something."""
    blocks: list[Block] = []
    if told.checklist:
        blocks.append(
            block("checklist", ["checklist", *(Sentence(_answer(one), "  ", "    ") for one in told.checklist)])
        )
    if told.ready is not None:
        blocks.append(block("readiness", [_readiness(told)]))
    if told.notes:
        blocks.append(block("session notes", ["notes", *(_note(one) for one in told.notes)]))
    return tuple(blocks)


def _answer(one: ToldAnswer) -> str:
    if one.answer is None:
        said = "not asked"
    elif isinstance(one.answer, bool):
        said = "yes" if one.answer else "no"
    else:
        said = f"{one.answer:g} {one.unit}".strip() if isinstance(one.answer, float | int) else one.answer
    return printable(f"{one.ask}: {said}")


def _readiness(told: ToldSession) -> Line:
    if told.ready:
        return "readiness: nothing had to be changed on the vehicle"
    return Sentence(printable(f"readiness: to be changed on the vehicle: {', '.join(told.to_change)}"), "", "  ")


def _note(one: ToldNote) -> Line:
    when = [printable(one.time[:19].replace("T", " "))] if one.time else []
    if one.air_s is not None:
        when.append(f"{int(one.air_s) // 60}:{int(one.air_s) % 60:02d} in the air")
    if one.run and one.run_s is not None:
        when.append(printable(f"{one.run_s:.0f} s into {one.run}"))
    return Sentence(f"{', '.join(when)}: {printable(one.text)}", "  ", "    ")
