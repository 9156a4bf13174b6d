"""The site's sources, arranged in a folder from which Sphinx makes the pages: `python docs/site/stage.py FOLDER`.

Files keep the paths that they have in the repository, so that their links lead where they lead there; README is cut
into its chapters; effects, commands, the Python API and the list of studies are written anew from what declares them.
"""

from __future__ import annotations

import re
import shutil
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
if __name__ == "__main__":
    sys.path[:0] = [str(ROOT), str(Path(__file__).parent)]

from api_pages import api_page  # noqa: E402
from command_pages import command_pages  # noqa: E402
from effect_pages import effect_pages  # noqa: E402
from study_pages import study_list  # noqa: E402

CHAPTERS = {
    "The app": "app",
    "A tour, on the simulated vehicle": "tour",
    "A vehicle with a secret": "secret",
    "With your own data": "own-data",
    "On a real vehicle": "real-vehicle",
    "What the numbers mean": "numbers",
}
"""README's chapters -> their pages."""
TITLES = {
    "tests/study/RESULTS.md": "Studies, and what they showed",
    "tests/study/EARLIER_RESULTS.md": "Judgements before, and what was learnt from each",
    "tests/benchmarks/RESULTS.md": "Speed, and beside whom",
}
"""Of pages that have many of their own."""
AS_THEY_ARE = (
    *("CHANGELOG.md", "CONTRIBUTING.md", "gcs/tui/glossary.md", "sysid/effects/README.md"),
    *TITLES,
)
CONTENTS = "\n```{{toctree}}\n:hidden:\n\n{}\n```\n"
THEORY = ("structures", "criterion", "bounds", "diagnosis", "stopping")
"""In the order in which they are read."""
LINK = re.compile(r"(?<!!)\[([^\]]+)\]\(([^)#:]+)(#[^)]*)?\)")
MERMAID = re.compile(r"```mermaid\n(.*?)```", re.DOTALL)
NODE = re.compile(r"(\w+)(?:\[\(|\[|\(\()\"?([^\"\]()]+)\"?(?:\)\]|\]|\)\))")


def stage(folder: Path) -> None:
    """Write all sources into `folder`, which is made anew."""
    shutil.rmtree(folder, ignore_errors=True)
    pages = {path.relative_to(ROOT).as_posix(): path for path in (ROOT / "docs").rglob("*.md")}
    pages = {name: path for name, path in pages.items() if not name.startswith("docs/site/")}
    pages |= {name: ROOT / name for name in AS_THEY_ARE}
    texts = {name: path.read_text(encoding="utf-8") for name, path in pages.items()}
    texts |= {path.name: path.read_text(encoding="utf-8") for path in (ROOT / "docs" / "site").glob("*.md")}
    texts |= {f"{CHAPTERS[title]}.md": text for title, text in chapters(ROOT / "README.md") if title in CHAPTERS}
    texts |= effect_pages() | command_pages()
    texts["docs/theory/README.md"] += CONTENTS.format("\n".join(THEORY))
    texts["api.rst"] = api_page()
    texts["studies.md"] = study_list(ROOT)
    for name, text in texts.items():
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(arranged(text, name, texts), encoding="utf-8")
    for picture in re.findall(r"!\[[^\]]*\]\(([^)]+)\)", (ROOT / "README.md").read_text(encoding="utf-8")):
        (folder / picture).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / picture, folder / picture)


def chapters(readme: Path) -> list[tuple[str, str]]:
    """Title and text of every chapter, its headings one level higher."""
    parts = re.split(r"^## (.*)\n", readme.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return [
        (title, f"# {title}\n{re.sub(r'^###', '##', text, flags=re.MULTILINE)}")
        for title, text in zip(parts[1::2], parts[2::2], strict=True)
    ]


def arranged(text: str, name: str, staged: dict[str, str]) -> str:
    """A page as the site shows it: one title, drawings as lists, and of links to code only the words."""
    if not name.endswith(".md"):
        return text
    text = MERMAID.sub(lambda found: listed(found[1]), text)
    if name in TITLES:
        text = f"# {TITLES[name]}\n\n{one_lower(text)}"
    here = Path(name).parent

    def led(found: re.Match[str]) -> str:
        target = _normal(here / found[2])
        if target in staged or (ROOT / target).suffix == ".png":
            return found[0]
        if target == "README.md":
            return found[1]
        return f"`{target}`" if found[1].strip("`/") in target else f"{found[1]} (`{target}`)"

    return LINK.sub(led, text)


def one_lower(text: str) -> str:
    """Headings one level lower, outside of code."""
    parts = re.split(r"(^```.*?^```)", text, flags=re.MULTILINE | re.DOTALL)
    parts[::2] = [re.sub(r"^#", "##", part, flags=re.MULTILINE) for part in parts[::2]]
    return "".join(parts)


def listed(drawing: str) -> str:
    """A flowchart that is a chain, as a numbered list: no script draws on these pages."""
    return "".join(f"{number}. {words}\n" for number, (_, words) in enumerate(NODE.findall(drawing), 1))


def _normal(path: Path) -> str:
    parts: list[str] = []
    for part in path.parts:
        if part == "..":
            parts.pop()
        elif part != ".":
            parts.append(part)
    return "/".join(parts)


if __name__ == "__main__":
    stage(Path(sys.argv[1]))
