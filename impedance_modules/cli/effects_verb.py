# SPDX-License-Identifier: BSD-3-Clause
"""``impedance effects``: the catalogue of physical effects, what each does and how it shows."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from impedance_modules.effects.effect import Effect
    from impedance_modules.effects.effect_description import Description, Parameter

KEY_WORDS = {
    "joint": "joint",
    "pair": "JOINT<-OTHER",
    "body": "link",
    "base": "base",
    "log": "log",
    "surface": "surface0, ...",
    "object": "object, which the hands hold",
}


@click.command("effects")
@click.argument("effect", metavar="[ID]", required=False)
def effects_command(effect: str | None) -> int:
    """Show all effects that plant and model can have and the diagnosis looks for, or one of them in full.

    Exit: 0 fine, 2 no such effect.
    """
    from impedance_modules.cli.terminal import Terminal
    from impedance_modules.effects.catalogue import CATALOGUE
    from impedance_modules.errors import BadInput, nearest

    console = Terminal()
    if effect is None:
        console.print(_overview([entry.description for entry in CATALOGUE.values()]))
        console.print("impedance effects ID shows one of them in full", highlight=False)
        return 0
    if effect not in CATALOGUE:
        known = tuple(CATALOGUE)
        raise BadInput(f"no effect '{effect}'{nearest(effect, known)} (valid: {', '.join(known)})")
    _print_card(CATALOGUE[effect], console)
    return 0


def _overview(descriptions: list[Description]) -> Table:
    from rich.table import Table
    from rich.text import Text

    table = Table(title=f"{len(descriptions)} physical effects", title_justify="left", show_lines=True)
    for name in ("effect", "what happens", "parameters", "ports"):
        table.add_column(name, no_wrap=name == "effect")
    for described in descriptions:
        symbols = ", ".join(f"{p.symbol} [{p.unit}]" for p in described.parameters)
        cells = (described.id, described.sentence, symbols, ", ".join(described.ports))
        table.add_row(*(Text(cell) for cell in cells))
    return table


def _print_card(effect: Effect, console: Console) -> None:
    """Prints everything that is known about one effect."""
    from rich.table import Table
    from rich.text import Text

    from impedance_modules.effects.compensate import compensation_words

    described = effect.description
    card = Table(title=described.id, title_justify="left", show_header=False, show_lines=True)
    rows = {
        "what happens": described.sentence,
        "equation": described.equation,
        "ports": ", ".join(f"{port} (place: {described.place(port)})" for port in described.ports),
        "numbers belong to": ", ".join(KEY_WORDS[kind] for kind in described.keys),
        "signature": described.signature,
        "looks like": ", ".join(described.confusable_with),
        "told apart by": described.excitation,
        "applied to": described.applied,
        "patch export": "; ".join(f"{part.quantity}, {part.equation}" for part in effect.exported)
        or f"refused: {effect.not_exported}",
        "compensated": compensation_words(effect),
        "reference": described.reference,
    }
    for name, text in rows.items():
        card.add_row(name, Text(text))
    console.print(card)
    console.print(_parameters(described.parameters))


def _parameters(parameters: tuple[Parameter, ...]) -> Table:
    from rich.table import Table
    from rich.text import Text

    table = Table(title="parameters", title_justify="left")
    for name in ("symbol", "unit", "sliding joint", "meaning", "physical", "left out"):
        table.add_column(name)
    for p in parameters:
        absent = "must be given" if p.left_out is None else p.left_out
        cells = (p.symbol, p.unit, p.linear_unit or p.unit, p.meaning, p.bounds or "any", absent)
        table.add_row(*(Text(cell) for cell in cells))
    return table
