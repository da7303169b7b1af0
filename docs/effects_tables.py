# SPDX-License-Identifier: BSD-3-Clause
"""Writes what follows from the catalogue of effects into the files that repeat it.

    python -m docs.effects_tables            rewrites them; run it after adding an effect
    python -m docs.effects_tables --check    exit 1 and the files' names if one of them is not up to date

They are the ids in schemas/patch.schema.json, the table in docs/effects.md, and the number of effects wherever
README.md or docs/*.md has it between the markers ``<!-- effect-count -->`` and ``<!-- /effect-count -->``.
"""

from __future__ import annotations

import re
import sys
import textwrap
from pathlib import Path

from impedance_modules.effects.catalogue import CATALOGUE
from impedance_modules.effects.effect import Effect

CHECKOUT = Path(__file__).resolve().parent.parent

COUNT = re.compile(r"(<!-- effect-count -->).*?(<!-- /effect-count -->)", re.DOTALL)
TABLE = re.compile(r"(<!-- effect-table -->\n).*?(<!-- /effect-table -->)", re.DOTALL)
ENUM = re.compile(
    r'("Which effect of the catalogue\.",\s*"type": "string",\s*"enum": \[).*?(\n *\])', re.DOTALL
)

SEARCHED = {"always": "yes", "under_water": "`--under-water`", "never": "no"}


def texts() -> dict[Path, str]:
    """Gives each file's text as the catalogue wants it."""
    schema = CHECKOUT / "schemas" / "patch.schema.json"
    out = {schema: ENUM.sub(rf"\g<1>\n{_ids()}\g<2>", schema.read_text())}
    for path in (CHECKOUT / "README.md", *sorted((CHECKOUT / "docs").glob("*.md"))):
        text = COUNT.sub(rf"\g<1>{len(CATALOGUE)}\g<2>", path.read_text())
        out[path] = TABLE.sub(lambda found: f"{found[1]}{_table()}\n{found[2]}", text)
    return out


def stale() -> list[Path]:
    """Lists the files that are not as the catalogue wants them."""
    return [path for path, text in texts().items() if path.read_text() != text]


def _ids() -> str:
    indent = " " * 12
    ids = ", ".join(f'"{name}"' for name in CATALOGUE)
    return textwrap.fill(
        ids, width=118, initial_indent=indent, subsequent_indent=indent, break_on_hyphens=False
    )


def _table() -> str:
    head = "| effect | what happens | numbers | carried by | ports | searched |"
    return "\n".join([head, "|---|---|---|---|---|---|", *map(_row, CATALOGUE.values())])


def _row(effect: Effect) -> str:
    described = effect.description
    numbers = ", ".join(f"{p.symbol} [{p.unit}]" for p in described.parameters)
    cells = (
        f"`{effect.id}`",
        described.sentence.replace("|", "\\|"),
        numbers,
        ", ".join(described.keys),
        ", ".join(described.ports),
        SEARCHED[effect.searched],
    )
    return f"| {' | '.join(cells)} |"


def main() -> int:
    """Writes the files, or checks them; returns the exit code."""
    behind = stale()
    if "--check" in sys.argv[1:]:
        for path in behind:
            print(f"{path.relative_to(CHECKOUT)}: not up to date; run python -m docs.effects_tables")
        return 1 if behind else 0
    for path, text in texts().items():
        if path in behind:
            path.write_text(text)
            print(f"wrote {path.relative_to(CHECKOUT)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
