"""A page for every effect of the catalogue, from its entry: what it declares, and its signature drawn."""

from __future__ import annotations

import re

from gcs.analysis.pages.page import BLACK, svg
from gcs.analysis.pages.signature import signature_picture, signatures_picture
from gcs.analysis.text.signature import signature_words
from gcs.cli.effects import GROUPS, null_words, range_words
from sysid.data.airframe import Airframe
from sysid.model.effect import catalogue
from sysid.model.signature import Signature, signature_of

BLACKS = re.compile(rf"(?:{BLACK}|#000000|black)\b", re.IGNORECASE)
INTRODUCTION = """\
# The catalogue of effects

What a structure may hold beside its base: {count} entries, each a file in `sysid/effects/`. `tippath effects` lists
them, `tippath effects ID` explains one, `tippath fit --with ID` composes it onto a base, and `tippath diagnose` asks
all that the runs can show. [How to write one](../docs/how-to/effect.md); [all that an entry can
declare](../sysid/effects/README.md).
"""


def effect_pages() -> dict[str, str]:
    """Path -> text, `effects/index.md` first."""
    signatures = {one.id: signature_of(one) for one in catalogue().values()}
    pages = {"effects/index.md": index(list(signatures.values()))}
    return pages | {f"effects/{name}.md": page(found) for name, found in signatures.items()}


def index(signatures: list[Signature]) -> str:
    lines = [INTRODUCTION.format(count=len(signatures))]
    for group, title in GROUPS.items():
        members = [one.effect for one in signatures if one.effect.group == group]
        lines += [f"## {title}\n", "| | effect | missing, the residual shows |", "|---|---|---|"]
        lines += [f"| [{one.id}]({one.id}.md) | {cell(one.title)} | {cell(one.signature)} |" for one in members]
        lines.append("")
    lines += ["## All signatures", "", "Each on the paper's vehicle at its typical size.", ""]
    lines += [drawn(signatures_picture(signatures)), "", "```{toctree}", ":hidden:", ""]
    return "\n".join([*lines, *(one.effect.id for one in signatures), "```", ""])


def page(found: Signature) -> str:
    effect = found.effect
    facts = {
        "equation": f"`{effect.equation}`",
        "where it is missing": effect.signature,
        "source": effect.source,
        "reads": ", ".join(f"`{name.replace('|', '` or `')}`" for name in effect.channels),
        "attitude": "phi and theta, integrated from p and q where they are not logged" if effect.attitude else "",
        "states": ", ".join(f"`{name}`" for name in effect.states),
        "needs": linked(effect.needs),
        "part of": linked(effect.absorbed_by),
        "contains": linked(effect.contains),
        "same as": linked(effect.same_as),
        "or two together": "; ".join(linked(pair) for pair in effect.made_of),
        "in place of": ", ".join(f"`{name}`" for name in effect.replaces),
        "acts on": effect.stage.name.lower(),
        "linear": "yes" if effect.linear else "no",
        "never on": ", ".join(f"a {one}" for one in Airframe if not effect.can_be_on(one)),
        "on a multirotor": "" if effect.on_multirotor is None else effect.on_multirotor.title,
    }
    lines = [f"# {effect.id}", "", f"{effect.title[0].upper()}{effect.title[1:]}.", "", "| | |", "|---|---|"]
    lines += [f"| {name} | {cell(text)} |" for name, text in facts.items() if text]
    lines += ["", "## Parameters", "", "| | unit | meaning | typical | null | plausible | bounds |"]
    lines.append("|---|---|---|---|---|---|---|")
    for one in effect.parameters:
        numbers = (f"{one.typical:g}", null_words(one.null), range_words(one.plausible), range_words(one.bounds))
        lines.append(f"| `{one.name}` | {one.unit} | {cell(one.meaning)} | {' | '.join(numbers)} |")
    words = signature_words(found)
    lines += ["", "## Signature", "", f"{words}.", "", drawn(signature_picture(found)), ""]
    lines += ["```sh", f"tippath effects {effect.id}", f"tippath fit FLIGHT --model tpp --with {effect.id}", "```", ""]
    return "\n".join(lines)


def linked(names: tuple[str, ...]) -> str:
    """Ids, alternatives among them, as links to their pages; bases as words."""
    known = catalogue()
    return ", ".join(
        " or ".join(f"[{one}]({one}.md)" if one in known else f"`{one}`" for one in name.split("|")) for name in names
    )


def cell(text: str) -> str:
    """Text as a table's cell: `|` is no border, `*` and `_` no emphasis."""
    outside = re.split(r"(`[^`]*`|\[[^\]]*\]\([^)]*\))", text.replace("|", r"\|"))
    outside[::2] = [re.sub(r"([*_<])", r"\\\1", part) for part in outside[::2]]
    return "".join(outside)


def drawn(figure: object) -> str:
    """A figure in the page's own colours: black is the page's ink, white its paper."""
    text = svg(figure).replace("#ffffff", "none").replace("#dddddd", "var(--color-background-border)")
    return f'<div class="picture">\n{BLACKS.sub("currentColor", text)}\n</div>'.replace("\n\n", "\n")
