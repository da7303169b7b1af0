# SPDX-License-Identifier: BSD-3-Clause
"""Writes what follows from the catalogue of effects into the files that repeat it.

    python -m docs.effects_tables            rewrites them; run it after adding an effect
    python -m docs.effects_tables --check    exit 1 and the files' names if one of them is not up to date

They are the ids in schemas/patch.schema.json, the table in docs/effects.md, the one in docs/chain.md of where in the
chain from command to log an effect can be, the tables in docs/export.md of what becomes of an effect in a URDF and in
a MuJoCo model, the table in docs/compensation.md of how a controller takes it back, and the number of effects
wherever README.md or docs/*.md has it between the markers ``<!-- effect-count -->`` and ``<!-- /effect-count -->``.
"""

from __future__ import annotations

import re
import sys
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import get_args

from impedance_modules.effects.catalogue import CATALOGUE
from impedance_modules.effects.compensate import compensation_words
from impedance_modules.effects.effect import Effect
from impedance_modules.effects.effect_description import Description, Place, Port
from impedance_modules.effects.simulator_numbers import MEANINGS, QUANTITIES, Quantity
from impedance_modules.export.carrier import D, Format
from impedance_modules.export.mujoco_format import MUJOCO
from impedance_modules.export.urdf_format import URDF

CHECKOUT = Path(__file__).resolve().parent.parent

CHAIN = re.compile(r"(<!-- effect-chain -->\n).*?(<!-- /effect-chain -->)", re.DOTALL)
COUNT = re.compile(r"(<!-- effect-count -->).*?(<!-- /effect-count -->)", re.DOTALL)
TABLE = re.compile(r"(<!-- effect-table -->\n).*?(<!-- /effect-table -->)", re.DOTALL)
EXPORTED = re.compile(r"(<!-- exported-effects -->\n).*?(<!-- /exported-effects -->)", re.DOTALL)
PLACES = re.compile(r"(<!-- exported-numbers -->\n).*?(<!-- /exported-numbers -->)", re.DOTALL)
COMPENSATED = re.compile(r"(<!-- compensated-effects -->\n).*?(<!-- /compensated-effects -->)", re.DOTALL)
ENUM = re.compile(
    r'("Which effect of the catalogue\.",\s*"type": "string",\s*"enum": \[).*?(\n *\])', re.DOTALL
)

SEARCHED = {
    "always": "yes",
    "under_water": "`--under-water`",
    "in_contact": "in contact",
    "while_held": "while held",
    "never": "no",
}


def texts() -> dict[Path, str]:
    """Gives each file's text as the catalogue wants it."""
    schema = CHECKOUT / "schemas" / "patch.schema.json"
    out = {schema: ENUM.sub(rf"\g<1>\n{_ids()}\g<2>", schema.read_text())}
    for path in (CHECKOUT / "README.md", *sorted((CHECKOUT / "docs").glob("*.md"))):
        text = COUNT.sub(rf"\g<1>{len(CATALOGUE)}\g<2>", path.read_text())
        tables = (
            (TABLE, _table), (CHAIN, _chain), (EXPORTED, _exported), (PLACES, _places), (COMPENSATED, _compensated),
        )  # fmt: skip
        for marked, table in tables:
            text = marked.sub(lambda found, table=table: f"{found[1]}{table()}\n{found[2]}", text)
        out[path] = text
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
    head = "| effect | what happens | numbers | carried by | port (place in the chain) | searched |"
    return "\n".join([head, "|---|---|---|---|---|---|", *map(_row, CATALOGUE.values())])


def _port(described: Description, port: Port) -> str:
    place = described.place(port)
    return port if place == port else f"{port} ({place})"


def _row(effect: Effect) -> str:
    described = effect.description
    numbers = ", ".join(f"{p.symbol} [{p.unit}]" for p in described.parameters)
    cells = (
        f"`{effect.id}`",
        described.sentence.replace("|", "\\|"),
        numbers,
        ", ".join(described.keys),
        ", ".join(_port(described, port) for port in described.ports),
        SEARCHED[effect.searched],
    )
    return f"| {' | '.join(cells)} |"


def _chain() -> str:
    """Which effect a machine can have at which link of the chain from command to log, and by which port."""
    places = get_args(Place)
    head = f"| effect | {' | '.join(place.replace('_', ' ') for place in places)} |"
    return "\n".join(
        [head, f"|---{'|---' * len(places)}|", *(_chain_row(e, places) for e in CATALOGUE.values())]
    )


def _chain_row(effect: Effect, places: Sequence[Place]) -> str:
    described = effect.description
    cells = [
        ", ".join(port for port in described.ports if described.place(port) == place) for place in places
    ]
    return f"| `{effect.id}` | {' | '.join(cells)} |"


def _exported() -> str:
    """What each effect changes in a simulator of rigid joints, or why nothing there is it."""
    head = "| effect | becomes | in a URDF | in MuJoCo |"
    return "\n".join([head, "|---|---|---|---|", *map(_exported_row, CATALOGUE.values())])


def _exported_row(effect: Effect) -> str:
    if not effect.exported:
        return f"| `{effect.id}` | refused: {effect.not_exported} | - | - |"
    described = effect.description
    becomes = [f"{part.quantity}: {part.equation}" for part in effect.exported]
    outside = [port for port in described.ports if not any(part.acts_at(port) for part in effect.exported)]
    becomes += [f"at the {port} refused: {effect.not_exported}" for port in outside]
    quantities = [part.quantity for part in effect.exported]
    taken = (
        "yes" if all(quantity in carriers for quantity in quantities) else "refused"
        for carriers in (URDF.carriers, MUJOCO.carriers)
    )
    return f"| `{effect.id}` | {'; '.join(becomes)} | {' | '.join(taken)} |"


def _compensated() -> str:
    """How a controller takes each effect back, or why it does not."""
    rows = (f"| `{name}` | {compensation_words(effect)} |" for name, effect in CATALOGUE.items())
    return "\n".join(["| effect | with `--compensate` |", "|---|---|", *rows])


def _places() -> str:
    """Where each number stands in each format, and by which equation."""
    head = "| number | URDF | MuJoCo |"
    rows = (
        f"| {quantity}: {MEANINGS[quantity]} | {_place(URDF, quantity)} | {_place(MUJOCO, quantity)} |"
        for quantity in QUANTITIES
    )
    return "\n".join([head, "|---|---|---|", *rows])


def _place(format_: Format[D], quantity: Quantity) -> str:
    if quantity in format_.refused:
        return f"refused: {format_.refused[quantity]}".replace("<", "\\<")
    carrier = format_.carriers[quantity]
    return f"{carrier.place}: {carrier.equation}".replace("<", "\\<")


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
