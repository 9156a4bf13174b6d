"""The house in numbers: rooms and arrows, sizes, and what a reader trips over. Nothing is imported, all is parsed.

    python tests/study/house.py [ROOT ...]      # a column each; this checkout where none is named
    python tests/study/house.py --list [ROOT]   # and every place that a count stands for

A room is a folder of a package with the folders in it; a file that lies loose beside a package's `__init__` belongs to
no room, and stands for itself where arrows are counted. An arrow is a room that imports from another, at the top of a
file or in a function. A circle is a set of rooms, or of files, that reach each other. Complexity counts branches,
loops, handlers, `with`, `assert`, conditions and their `and` and `or`, comprehensions and their conditions. A
function's lines hold its nested functions' too. Lines of code are those without blanks, comments and docstrings.
"""

from __future__ import annotations

import argparse
import ast
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

PACKAGES = ("gcs", "sysid", "sitl")
FILE_LINES, FUNCTION_LINES, COMPLEXITY, ARGUMENTS, FIELDS = 500, 60, 20, 6, 6
"""Where a file, a function, a call or a dataclass is too big."""
BODY_NODES = 20
"""From how many nodes of syntax on (some two lines) a repeated function body is counted."""
NO_CONSTRUCTION = {"np", "struct", "math"}
_ARRAY = re.compile(r"\b(?:NDArray|ndarray|\w+Array)\b")
_SHAPE = re.compile(r"\((?:[\w ·*+/-]+,\s*)+(?:[\w ·*+/-]+|\.\.\.)?\)|\(\.\.\.,|scalar")
"""`(runs, bins)`, `(n,)`, `(..., 2)`."""

Function = ast.FunctionDef | ast.AsyncFunctionDef
Graph = Mapping[str, set[str]]


@dataclass(frozen=True)
class Source:
    """One parsed file."""

    module: str
    path: Path
    text: str
    tree: ast.Module

    @cached_property
    def nodes(self) -> tuple[ast.AST, ...]:
        """All of the tree's."""
        return tuple(ast.walk(self.tree))

    @property
    def lines(self) -> int:
        return self.text.count("\n")

    @property
    def code_lines(self) -> int:
        """Without blanks, comments and strings that stand alone."""
        filled: set[int] = set()
        for node in self.nodes:
            if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
                continue
            if isinstance(node, ast.stmt):
                filled |= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
        for node in self.nodes:
            if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
                filled -= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
        texts = self.text.splitlines()
        return sum(bool(texts[line - 1].strip()) and not texts[line - 1].strip().startswith("#") for line in filled)


@dataclass
class House:
    """What was counted; each count is a list of places."""

    sources: list[Source]
    tests: list[Source]
    rooms: Graph = field(default_factory=dict)
    files: Graph = field(default_factory=dict)
    counts: dict[str, list[str]] = field(default_factory=dict)


def sources(root: Path, packages: Sequence[str]) -> list[Source]:
    """Every Python file of the packages, by name."""
    there = []
    for package in packages:
        for path in sorted((root / package).rglob("*.py")):
            text = path.read_text(encoding="utf-8")
            module = ".".join(path.relative_to(root).with_suffix("").parts).removesuffix(".__init__")
            there.append(Source(module, path.relative_to(root), text, ast.parse(text)))
    return there


# ------------------------------------------------------------------------------------------------- rooms and arrows


def room(source: Source) -> str:
    """`gcs.logs` for all below that folder, `gcs.errors` for a loose file, `gcs` for the package's own `__init__`."""
    return ".".join(source.module.split(".")[:2])


def is_loose(source: Source) -> bool:
    return len(source.path.parts) == 2 and source.path.name != "__init__.py"


def imported(source: Source, known: Mapping[str, Source]) -> Iterator[str]:
    """Modules of the house that a file imports, wherever in it."""
    for node in source.nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in known)
        elif isinstance(node, ast.ImportFrom) and node.module is not None and node.level == 0:
            for alias in node.names:
                full = f"{node.module}.{alias.name}"
                if full in known or node.module in known:
                    yield full if full in known else node.module


def graphs(product: Sequence[Source]) -> tuple[Graph, Graph]:
    """Room -> rooms it imports from, and file -> files."""
    known = {source.module: source for source in product}
    rooms: dict[str, set[str]] = {room(source): set() for source in product}
    files: dict[str, set[str]] = {source.module: set() for source in product}
    for source in product:
        for target in imported(source, known):
            files[source.module] |= {target} - {source.module}
            rooms[room(source)] |= {room(known[target])} - {room(source)}
    return rooms, files


def circles(graph: Graph) -> list[list[str]]:
    """Sets of two and more that reach each other."""
    reach = {name: _reached(graph, name) for name in graph}
    rest, there = set(graph), []
    while rest:
        name = min(rest)
        circle = {other for other in reach[name] if name in reach[other]} | {name}
        if len(circle) > 1:
            there.append(sorted(circle))
        rest -= circle
    return there


def _reached(graph: Graph, name: str) -> set[str]:
    seen: set[str] = set()
    todo = [name]
    while todo:
        for target in graph[todo.pop()] - seen:
            seen.add(target)
            todo.append(target)
    return seen


# ------------------------------------------------------------------------------------------------- sizes


def functions(source: Source) -> Iterator[Function]:
    return _functions(source.nodes)


def _functions(nodes: Iterable[ast.AST]) -> Iterator[Function]:
    return (node for node in nodes if isinstance(node, Function))


def complexity(function: ast.AST) -> int:
    branches = (ast.If, ast.For, ast.AsyncFor, ast.While, ast.ExceptHandler, ast.With, ast.AsyncWith, ast.IfExp)
    total = 1
    for node in ast.walk(function):
        if isinstance(node, (*branches, ast.Assert, ast.match_case)):
            total += 1
        elif isinstance(node, ast.BoolOp):
            total += len(node.values) - 1
        elif isinstance(node, ast.comprehension):
            total += 1 + len(node.ifs)
    return total


def long_functions(source: Source) -> Iterator[str]:
    for function in functions(source):
        lines = (function.end_lineno or function.lineno) - function.lineno + 1
        if lines > FUNCTION_LINES:
            yield f"{source.path}:{function.lineno} {function.name}, {lines} lines"


def complex_functions(source: Source) -> Iterator[str]:
    for function in functions(source):
        if complexity(function) > COMPLEXITY:
            yield f"{source.path}:{function.lineno} {function.name}, {complexity(function)}"


# ------------------------------------------------------------------------------------------------- habits


def inner_imports(source: Source, own: bool) -> Iterator[str]:
    """Imports in functions; `own`: of the house, not of libraries."""
    lines = {
        (node.lineno, ast.unparse(node))
        for function in functions(source)
        for node in ast.walk(function)
        if isinstance(node, ast.Import | ast.ImportFrom)
    }
    for line, text in sorted(lines):
        if not own or text.split()[1].split(".")[0] in PACKAGES:
            yield f"{source.path}:{line} {text}"


def long_calls(source: Source, construction: bool) -> Iterator[str]:
    """Calls with six and more positional arguments: of a class, or of a function."""
    for node in source.nodes:
        if not isinstance(node, ast.Call):
            continue
        called = ast.unparse(node.func)
        given = sum(not isinstance(argument, ast.Starred) for argument in node.args)
        capital = called.split(".")[-1].lstrip("_")[:1].isupper()
        if given >= ARGUMENTS and capital == construction and called.split(".")[0] not in NO_CONSTRUCTION:
            yield f"{source.path}:{node.lineno} {called[:50]} with {given}"


def is_dataclass(node: ast.ClassDef) -> bool:
    return any("dataclass" in ast.unparse(decorator) for decorator in node.decorator_list)


def positional_dataclasses(source: Source) -> Iterator[str]:
    for node in source.nodes:
        if isinstance(node, ast.ClassDef) and is_dataclass(node):
            fields = sum(isinstance(statement, ast.AnnAssign) for statement in node.body)
            if fields >= FIELDS and not any("kw_only=True" in ast.unparse(one) for one in node.decorator_list):
                yield f"{source.path}:{node.lineno} {node.name}, {fields} fields"


class Renamed(ast.NodeTransformer):
    """Local names by their order of appearance, so that two bodies compare by their shape."""

    def __init__(self) -> None:
        self.names: dict[str, str] = {}

    def _name(self, name: str) -> str:
        return self.names.setdefault(name, f"n{len(self.names)}")

    def visit_Name(self, node: ast.Name) -> ast.Name:
        return ast.Name(self._name(node.id), node.ctx)

    def visit_arg(self, node: ast.arg) -> ast.arg:
        return ast.arg(self._name(node.arg), None)


def same_bodies(product: Sequence[Source]) -> list[str]:
    """Functions whose body stands in several places, but for docstrings, annotations and the names of its variables."""
    places = defaultdict(list)
    for source in product:
        for function in _functions(ast.walk(ast.parse(source.text))):
            body = function.body[1:] if ast.get_docstring(function, clean=False) is not None else function.body
            if sum(1 for statement in body for _ in ast.walk(statement)) >= BODY_NODES:
                bare = Renamed().visit(ast.Module([ast.FunctionDef("f", function.args, body, [])], []))
                places[ast.dump(bare)].append(f"{source.path}:{function.lineno} {function.name}")
    return [" = ".join(where) for where in places.values() if len(where) > 1]


def same_class_names(product: Sequence[Source]) -> list[str]:
    places = defaultdict(list)
    for source in product:
        for node in source.nodes:
            if isinstance(node, ast.ClassDef):
                places[node.name].append(f"{source.path}:{node.lineno}")
    return [f"{name}: {', '.join(where)}" for name, where in sorted(places.items()) if len(where) > 1]


# ------------------------------------------------------------------------------------------------- documentation


def public(tree: ast.Module) -> Iterator[Function | ast.ClassDef]:
    """Classes, functions and methods without an underscore; dunder methods and nested functions do not count."""
    for node in tree.body:
        if isinstance(node, Function | ast.ClassDef) and not node.name.startswith("_"):
            yield node
            if isinstance(node, ast.ClassDef):
                yield from (one for one in node.body if isinstance(one, Function) and not one.name.startswith("_"))


def array_fields(source: Source) -> Iterator[tuple[str, bool]]:
    """Public arrays of public dataclasses, and whether a shape stands at the field or in the class's docstring."""
    for node in public(source.tree):
        if not (isinstance(node, ast.ClassDef) and is_dataclass(node)):
            continue
        lines = source.text.splitlines()
        for number, statement in enumerate(node.body):
            if not (isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name)):
                continue
            if statement.target.id.startswith("_") or not _ARRAY.search(ast.unparse(statement.annotation)):
                continue
            told = lines[statement.lineno - 1] + _string(node.body[number + 1 : number + 2])
            shaped = _SHAPE.search(told.split(":", 1)[-1]) or _SHAPE.search(ast.get_docstring(node) or "")
            yield f"{source.path}:{statement.lineno} {node.name}.{statement.target.id}", shaped is not None


def _string(statements: Sequence[ast.stmt]) -> str:
    match statements:
        case [ast.Expr(ast.Constant(str() as text))]:
            return text
    return ""


def share(part: int, whole: int) -> str:
    return "-" if whole == 0 else f"{100 * part / whole:.0f} % of {whole}"


# ------------------------------------------------------------------------------------------------- the table


def measure(root: Path) -> House:
    """Everything of a checkout."""
    product, tests = sources(root, PACKAGES), sources(root, ["tests"])
    house = House(product, tests)
    house.rooms, house.files = graphs(product)

    def each(places: Iterator[Iterator[str]]) -> list[str]:
        return [place for of_file in places for place in of_file]

    house.counts = {
        "rooms": sorted({room(s) for s in product if len(s.path.parts) > 2}),
        "files loose in a package": [str(s.path) for s in product if is_loose(s)],
        "arrows between rooms": [f"{a} -> {b}" for a, targets in sorted(house.rooms.items()) for b in sorted(targets)],
        "circles between rooms": [" - ".join(circle) for circle in circles(house.rooms)],
        "arrows between files": [f"{a} -> {b}" for a, targets in sorted(house.files.items()) for b in sorted(targets)],
        "circles between files": [" - ".join(circle) for circle in circles(house.files)],
        "files above 500 lines": [f"{s.path}, {s.lines} lines" for s in product if s.lines > FILE_LINES],
        "functions above 60 lines": each(map(long_functions, product)),
        "functions of a complexity above 20": each(map(complex_functions, product)),
        "imports inside functions": each(inner_imports(s, own=False) for s in product),
        "  of the house's own": each(inner_imports(s, own=True) for s in product),
        "constructions with 6 positional and more": each(long_calls(s, construction=True) for s in product),
        "other calls with 6 positional and more": each(long_calls(s, construction=False) for s in product),
        "dataclasses of 6 fields, not keyword-only": each(map(positional_dataclasses, product)),
        "function bodies in several places": same_bodies(product),
        "class names in several places": same_class_names(product),
        "public without docstring": [
            f"{s.path}:{node.lineno} {node.name}" for s in product for node in public(s.tree)
            if ast.get_docstring(node) is None
        ],
        "public array fields without shape": [
            place for s in product for place, shaped in array_fields(s) if not shaped
        ],
    }  # fmt: skip
    return house


def figures(house: House) -> dict[str, str]:
    """Row -> number, in the order of the table."""
    lines = [
        (function.end_lineno or function.lineno) - function.lineno + 1
        for source in house.sources
        for function in functions(source)
    ]
    names = sum(1 for source in house.sources for _ in public(source.tree))
    arrays = sum(1 for source in house.sources for _ in array_fields(source))
    counts = {name: str(len(places)) for name, places in house.counts.items()}
    undocumented, unshaped = (
        int(counts.pop(key)) for key in ("public without docstring", "public array fields without shape")
    )
    return counts | {
        "product files": str(len(house.sources)),
        "product lines": str(sum(source.lines for source in house.sources)),
        "  of code": str(sum(source.code_lines for source in house.sources)),
        "test lines": str(sum(source.lines for source in house.tests)),
        "functions": str(len(lines)),
        "  median of their lines": str(sorted(lines)[len(lines) // 2]) if lines else "-",
        "public names with a docstring": share(names - undocumented, names),
        "public array fields with a shape": share(arrays - unshaped, arrays),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("root", nargs="*", type=Path)
    parser.add_argument("--list", action="store_true", help="name every place")
    given = parser.parse_args()
    roots = given.root or [Path(__file__).resolve().parents[2]]
    houses = [measure(root) for root in roots]
    columns = [figures(house) for house in houses]
    width = max(max(len(value) for value in column.values()) for column in columns) + 3
    for row in columns[0]:
        print(f"{row:42}" + "".join(f"{column[row]:>{width}}" for column in columns))
    if given.list:
        for root, house in zip(roots, houses, strict=True):
            for name, places in house.counts.items():
                print(f"\n{name.strip()}, {root}: {len(places)}")
                for place in places:
                    print(f"    {place}")


if __name__ == "__main__":
    main()
