# SPDX-License-Identifier: BSD-3-Clause
"""Compares the answers of two versions of the diagnosis: words must be the same, and numbers up to rounding.

    python -m benchmarks.diagnosis.same_answers out/before out/after

The folders hold SET.json, as ``diagnose_speed --answers`` keeps them. Of each set the largest difference of a number is
printed, relative to the larger of both, and where it is.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click

DIFFERENT = 1e-3
"""Relative difference of numbers from which an answer counts as another one."""
ABSOLUTE = 1e-9
"""Numbers nearer to each other than this are the same: remainders of nothing."""


def leaves(value: Any, place: str = "") -> Iterator[tuple[str, Any]]:
    """Yields every word and number of an answer with its place."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from leaves(inner, f"{place}.{key}")
    elif isinstance(value, list):
        for index, inner in enumerate(value):
            yield from leaves(inner, f"{place}[{index}]")
    else:
        yield place, value


def difference(before: Any, after: Any) -> tuple[float, str]:
    """Returns the largest relative difference and its place; infinite where words or keys differ."""
    one, other = dict(leaves(before)), dict(leaves(after))
    for place in [*one, *other]:
        if place not in one or place not in other:
            return float("inf"), place
    worst = (0.0, "")
    for place, value in one.items():
        new = other[place]
        if isinstance(value, float | int) and isinstance(new, float | int) and not isinstance(value, bool):
            apart = abs(value - new)
            found = 0.0 if apart < ABSOLUTE else apart / max(abs(value), abs(new))
        else:
            found = 0.0 if value == new else float("inf")
        if found > worst[0]:
            worst = (found, place)
    return worst


@click.command()
@click.argument("before", type=click.Path(path_type=Path, exists=True))
@click.argument("after", type=click.Path(path_type=Path, exists=True))
def main(before: Path, after: Path) -> None:
    """Prints one line per answer that both folders hold; ends with 1 where one is another."""
    others = 0
    for path in sorted(before.glob("*.json")):
        if not (after / path.name).exists():
            continue
        first, second = (json.loads((folder / path.name).read_text()) for folder in (before, after))
        apart, place = difference(first, second)
        others += apart > DIFFERENT
        click.echo(f"{path.stem:14} {first['verdict']:18} {apart:8.1e}  {place}")
    if others:
        raise SystemExit(1)


if __name__ == "__main__":
    main()
