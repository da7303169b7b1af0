# SPDX-License-Identifier: BSD-3-Clause
"""Draws which folder imports which, from the import statements of the code, into docs/architecture.md.

    python -m docs.imports_picture            rewrites the pictures; run it after imports have changed
    python -m docs.imports_picture --check    exit 1 if a picture is not up to date

A picture stands between the markers ``<!-- imports FOLDER -->`` and ``<!-- /imports -->``, as a Mermaid flowchart.
An arrow is left out where a longer way of arrows says the same: cli -> runs -> episode, no arrow cli -> episode.
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parent.parent
DOCUMENT = CHECKOUT / "docs" / "architecture.md"
EXPERIMENTS = "impedance_experiments"
"""A package beside the other; it is drawn as one box."""
BOTTOM = {
    "arrays",
    "errors",
    "extras",
    "input_files",
    "strict_json",
    "plain_figures",
    "worker_processes",
    "compiled",
    "records",
    "machine_code",
}
EVERYWHERE = frozenset(BOTTOM | {"__init__", "__main__"})
"""Files that nearly every folder imports; their arrows would say nothing."""
MARKED = re.compile(r"(<!-- imports (?P<folder>\S+) -->\n).*?(<!-- /imports -->)", re.DOTALL)

Graph = dict[str, set[str]]


def imported_modules(path: Path) -> Iterator[str]:
    """Yields the dotted names of the modules that a file imports, at any depth."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def imports_between(folder: Path) -> Graph:
    """Returns, for each part (folder or file) of a package, the other parts that it imports."""
    prefix = folder.relative_to(CHECKOUT).parts
    graph: Graph = {}
    for path in sorted(folder.rglob("*.py")):
        relative = path.relative_to(folder)
        own = relative.parts[0] if len(relative.parts) > 1 else relative.stem
        found = {part for name in imported_modules(path) if (part := _part(name, prefix))}
        graph.setdefault(own, set()).update(found - {own})
    if folder.name == "impedance_modules":
        files = sorted((CHECKOUT / EXPERIMENTS).glob("*.py"))
        found = {part for path in files for name in imported_modules(path) if (part := _part(name, prefix))}
        graph[EXPERIMENTS] = found - {EXPERIMENTS}
    return {
        own: {other for other in others - EVERYWHERE if other in graph}
        for own, others in graph.items()
        if own not in EVERYWHERE
    }


def _part(name: str, prefix: tuple[str, ...]) -> str | None:
    """Names the part of a package that a module belongs to; None for modules outside of it."""
    parts = tuple(name.split("."))
    if parts[0] == EXPERIMENTS:
        return EXPERIMENTS
    return parts[len(prefix)] if parts[: len(prefix)] == prefix and len(parts) > len(prefix) else None


def without_detours(graph: Graph) -> Graph:
    """Leaves out each arrow whose end is reached by a longer way as well (the graph has no loops)."""
    reached = {own: _reached(own, graph) for own in graph}
    return {
        own: {end for end in ends if not any(end in reached[other] for other in ends - {end})}
        for own, ends in graph.items()
    }


def _reached(start: str, graph: Graph) -> set[str]:
    found: set[str] = set()
    ahead = set(graph[start])
    while ahead:
        part = ahead.pop()
        if part not in found:
            found.add(part)
            ahead |= graph[part]
    return found


def flowchart(folder: Path) -> str:
    """Writes a package's picture as Markdown."""
    graph = without_detours(imports_between(folder))
    arrows = [f"    {own} --> {' & '.join(sorted(ends))}" for own, ends in sorted(graph.items()) if ends]
    return "\n".join(["```mermaid", "flowchart TD", *arrows, "```"])


def text() -> str:
    """Returns docs/architecture.md with its pictures drawn anew."""
    old = DOCUMENT.read_text(encoding="utf-8")
    return MARKED.sub(lambda found: f"{found[1]}{flowchart(CHECKOUT / found['folder'])}\n{found[3]}", old)


def main() -> int:
    """Writes the pictures, or checks them; returns the exit code."""
    behind = text() != DOCUMENT.read_text(encoding="utf-8")
    if behind and "--check" in sys.argv[1:]:
        print(f"{DOCUMENT.relative_to(CHECKOUT)}: not up to date; run python -m docs.imports_picture")
        return 1
    if behind:
        DOCUMENT.write_text(text(), encoding="utf-8")
        print(f"wrote {DOCUMENT.relative_to(CHECKOUT)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
