"""`tippath effects`: the catalogue of physical effects, or one entry of it with all that it declares."""

from __future__ import annotations

import argparse
import math
import sys
import textwrap
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gcs.cli.options import add_plot_option, print_json, refuse_plot, write_plot
from gcs.errors import TippathError, UsageError
from sysid.data.airframe import Airframe

if TYPE_CHECKING:
    from gcs.tui.plot import Style
    from sysid.model.effect import Effect
    from sysid.model.parameter import Parameter
    from sysid.model.signature import Signature

FORMAT = "tippath.effects/1"
WIDTH = 78
PLOT_HEIGHT = 12
GROUPS = {
    "rotor": "Rotor",
    "fuselage": "Fuselage",
    "forward": "Forward flight",
    "actuators": "Actuators",
    "sensors": "Sensors",
}

_FORMAT_HELP = """\
--json prints {"format": "tippath.effects/1", "effects": [{"id", "title", "group", "equation", "source", "signature",
"parameters": [{"name", "unit", "meaning", "null", "null_is_infinite", "bounds": [low, high], "plausible": [low, high],
"typical", "grid"}], "channels", "attitude", "states", "needs", "absorbed_by", "airframes", "replaces", "slot", "stage",
"order", "linear", "path", "sha256"}]}; null in a range is an open end, null as a parameter's "null" none or infinite.
"""


def add_parser(subparsers: Any) -> None:
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "effects",
        help="the catalogue of physical effects",
        description="List the physical effects that a structure may hold, or explain one: equation, parameters, "
        "source, and what the residual looks like where it is missing.",
        epilog=_FORMAT_HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "effect", nargs="?", metavar="ID", help="a catalogue id, or the path of your own effect file (its code runs)"
    )
    parser.add_argument("--how-to", action="store_true", help="print how to write an effect of your own")
    add_plot_option(parser, "draw what it does")
    parser.add_argument("--force", action="store_true", help="overwrite the file")
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    from sysid.model.effect import FOLDER, EffectError, catalogue, find

    if args.how_to:
        print((FOLDER / "README.md").read_text(encoding="utf-8"), end="")
        return 0
    refuse_plot(args.plot, args.force)
    if args.effect is None:
        found = list(catalogue().values())
    else:
        try:
            found = [find(args.effect)]
        except EffectError as error:
            if args.effect.endswith(".py"):
                raise
            raise UsageError(str(error)) from error
    if args.plot is not None:
        draw(args.plot, found)
    if args.json:
        print_json({"format": FORMAT, "effects": [entry(one) for one in found]})
    elif args.effect is None:
        print(table(found))
    else:
        print("\n".join([explanation(found[0]), *signature_lines(found[0], plot_style())]))
    return 0


def draw(path: Path, effects: Sequence[Effect]) -> None:
    """What each does to the paper's vehicle, into a file; one that cannot stand there is left out."""
    from gcs.analysis.pages.signature import signature_picture, signatures_picture

    signatures = [made for made in map(signature, effects) if made is not None]
    if not signatures:
        raise TippathError(f"{effects[0].id} cannot stand on the paper's vehicle alone: there is nothing to draw")
    single = len(effects) == 1
    figure = signature_picture(signatures[0]) if single else signatures_picture(signatures)
    text = explanation(effects[0]) if single else table(effects)
    write_plot(path, lambda: figure, f"tippath effects: {effects[0].id if single else 'the catalogue'}", text)


def signature(effect: Effect) -> Signature | None:
    """None where it cannot stand on the paper's vehicle: a user's own, of another base."""
    from sysid.model.effect import EffectError
    from sysid.model.signature import signature_of

    try:
        return signature_of(effect)
    except EffectError:
        return None


def plot_style() -> Style:
    """As the terminal, or the file behind it, can show."""
    return "braille" if (sys.stdout.encoding or "").lower().startswith("utf") else "ascii"


def signature_lines(effect: Effect, style: Style) -> list[str]:
    """What it does to the paper's vehicle, drawn in 78 columns."""
    import numpy as np

    from gcs.analysis.text.signature import signature_words
    from gcs.tui.plot import FrequencyPlot, Panel, Plot, TimePlot, View, picture, prepared
    from sysid.model.signature import FREQUENCY_HZ as HZ

    found = signature(effect)
    if found is None:
        return []
    lines = _wrapped(f"{'signature':<12}{signature_words(found)}", 2, 12)
    if found.decibels is not None and found.degrees is not None:
        gain = Panel(name="Δ dB", x=HZ, line=found.decibels, unit="dB", least=1.0)
        phase = Panel(name="Δ deg", x=HZ, line=found.degrees, unit="deg", least=10.0, wraps=True)
        plot: Plot = FrequencyPlot(panels=(gain, phase), low_hz=float(HZ[0]), high_hz=float(HZ[-1]))
        view = View(float(np.log10(HZ[0])), float(np.log10(HZ[-1])))
    else:
        with_it = Panel(name=found.output, x=found.t, line=found.without, over=found.with_effect, unit="rad/s")
        change = Panel(name="Δ", x=found.t, line=found.with_effect - found.without, unit="rad/s", least=0.01)
        plot = TimePlot(panels=(with_it, change), words=("without it", "with it", ""))
        view = View(float(found.t[0]), float(found.t[-1]))
    rows = picture(prepared(plot), view, WIDTH, PLOT_HEIGHT, style)
    return lines + ["".join(text for text, _ in row).rstrip() for row in rows]


def entry(effect: Effect) -> dict[str, Any]:
    """One effect in the `tippath.effects/1` document."""
    return {
        "id": effect.id,
        "title": effect.title,
        "group": effect.group,
        "equation": effect.equation,
        "source": effect.source,
        "signature": effect.signature,
        "parameters": [_parameter_entry(one) for one in effect.parameters],
        "channels": [name.split("|") if "|" in name else name for name in effect.channels],
        "attitude": effect.attitude,
        "states": list(effect.states),
        "needs": [name.split("|") if "|" in name else name for name in effect.needs],
        "absorbed_by": list(effect.absorbed_by),
        "airframes": list(effect.airframes),
        "replaces": list(effect.replaces),
        "slot": effect.slot,
        "stage": effect.stage.name.lower(),
        "order": effect.order,
        "linear": effect.linear,
        "path": effect.path,
        "sha256": effect.sha256,
    }


def _parameter_entry(one: Parameter) -> dict[str, Any]:
    return {
        "name": one.name,
        "unit": one.unit,
        "meaning": one.meaning,
        "null": None if one.null is None else _finite(one.null),
        "null_is_infinite": one.null is not None and math.isinf(one.null),
        "bounds": [_finite(x) for x in one.bounds],
        "plausible": [_finite(x) for x in one.plausible],
        "typical": one.typical,
        "grid": list(one.grid),
    }


def _finite(x: float) -> float | None:
    return x if math.isfinite(x) else None


def table(effects: Iterable[Effect]) -> str:
    """The catalogue by groups; 78 columns."""
    lines: list[str] = []
    group = None
    for one in effects:
        if one.group != group:
            group = one.group
            lines += ["", GROUPS.get(group, group)] if lines else [GROUPS.get(group, group)]
        needs = _alternatives(one.channels)
        lines.append(f"  {one.id:<22} {one.title:<36}{f' needs {needs}' if needs else ''}".rstrip())
        if len(lines[-1]) > WIDTH:
            lines[-1:] = [f"  {one.id:<22} {one.title}", *_wrapped(f"needs {needs}", 25)]
    lines += ["", "`tippath effects ID` explains one; `tippath effects --how-to`, how to add one."]
    return "\n".join(lines)


def explanation(effect: Effect) -> str:
    """All that one effect declares, for people; 78 columns."""
    lines = [f"{effect.id}: {effect.title}"]
    for name, text in (
        ("equation", effect.equation),
        ("missing", effect.signature),
        ("source", effect.source),
        ("channels", _channels(effect)),
        ("needs", _alternatives(effect.needs)),
        ("part of", _alternatives(effect.absorbed_by)),
        ("in place of", _alternatives(effect.replaces)),
        ("never on", ", ".join(f"a {one}" for one in Airframe if not effect.can_be_on(one))),
        ("multirotor", _on_multirotor(effect)),
        ("file", effect.path or ""),
    ):
        if text:
            lines += _wrapped(f"{name:<12}{text}", 2, 12)
    lines.append("  parameters")
    width = max(len(one.name) for one in effect.parameters) if effect.parameters else 0
    for one in effect.parameters:
        unit = "" if one.unit == "-" else f", {one.unit}"
        lines += _wrapped(f"{one.name:<{width}}  {one.meaning}{unit}; typically {one.typical:g}", 4, width + 2)
        ranges = (
            f"null {null_words(one.null)}; plausible {range_words(one.plausible)}; bounds {range_words(one.bounds)}"
        )
        lines += _wrapped(ranges, width + 6)
    return "\n".join(lines)


def _on_multirotor(effect: Effect) -> str:
    """What it is there, where that is something else."""
    words = effect.on_multirotor
    return "" if words is None else f"{words.title}; {words.source}"


def _channels(effect: Effect) -> str:
    attitude = "phi and theta, integrated from p and q where not logged" if effect.attitude else ""
    return ", ".join(text for text in (_alternatives(effect.channels), attitude) if text)


def _alternatives(names: Iterable[str]) -> str:
    return ", ".join(name.replace("|", " or ") for name in names)


def _wrapped(text: str, indent: int, hanging: int = 0) -> list[str]:
    return textwrap.wrap(
        text,
        WIDTH,
        initial_indent=" " * indent,
        subsequent_indent=" " * (indent + hanging),
        break_long_words=False,
        break_on_hyphens=False,
    )


def null_words(x: float | None) -> str:
    if x is None:
        return "none"
    return "infinite" if math.isinf(x) else f"{x:g}"


def range_words(limits: tuple[float, float]) -> str:
    low, high = limits
    if low == high:
        return f"{low:g} only"
    if math.isinf(low) and math.isinf(high):
        return "any"
    if math.isinf(high):
        return f"from {low:g}"
    if math.isinf(low):
        return f"up to {high:g}"
    return f"{low:g} to {high:g}"
