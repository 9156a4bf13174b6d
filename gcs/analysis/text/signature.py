"""What a signature shows, in words."""

from __future__ import annotations

from sysid.data.record import CHANNELS
from sysid.model.signature import Signature


def signature_words(found: Signature) -> str:
    """What is drawn, and on which vehicle."""
    beside = f" with {', '.join(found.beside)}" if found.beside else ""
    on = f"on the paper's vehicle{beside}, every parameter at its typical value{held_words(found)}"
    if found.decibels is None:
        return f"{found.output} in doublets of {found.command}, a large one and a small one: {on}"
    return f"{found.output} from {found.command}, with it over without it: {on}"


def held_words(found: Signature) -> str:
    """`, at r 0.6 rad/s`: what is read and was no doublet."""
    told = ", ".join(f"{name} {value:.3g}{_unit(name)}" for name, value in found.held.items())
    return f", at {told}" if told else ""


def _unit(name: str) -> str:
    unit = CHANNELS.get(name, "-")
    return "" if unit.startswith("-") else f" {unit}"
