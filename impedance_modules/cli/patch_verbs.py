# SPDX-License-Identifier: BSD-3-Clause
"""``impedance patch export``: a patch becomes part of a URDF or of a MuJoCo model."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from impedance_modules.cli.plain_lines import say

if TYPE_CHECKING:
    from impedance_modules.export.edited_xml import Change

PATH = click.Path(path_type=Path)


@click.group("patch")
def patch_command() -> None:
    """What can be done with a patch beside applying it (run, diagnose and sweep --effects)."""


@patch_command.command("export")
@click.argument("patch", metavar="PATCH", type=PATH)
@click.option("--urdf", type=PATH, metavar="FILE", help="URDF that the patch is carried into.")
@click.option(
    "--mujoco", type=PATH, metavar="FILE", help="MuJoCo model (MJCF) that the patch is carried into."
)
@click.option("--out", required=True, type=PATH, metavar="FILE", help="Where the changed file goes.")
def export_command(patch: Path, urdf: Path | None, mujoco: Path | None, out: Path) -> int:
    """Carry PATCH into your own simulator: write a URDF or a MuJoCo model with its effects in it.

    Joints and links go by their names. All that the patch does not change stays as it was, comments and spaces too.
    docs/export.md says what becomes of which effect. If one cannot be carried, all such are named with the reason,
    and nothing is written.

    Exit: 0 done, 2 bad input, or an effect that the format cannot carry.
    """
    from impedance_modules.errors import BadInput
    from impedance_modules.export.mujoco_format import MUJOCO
    from impedance_modules.export.patch_export import export_patch
    from impedance_modules.export.urdf_format import URDF

    if (urdf is None) == (mujoco is None):
        raise BadInput(
            "patch export needs the file to carry the patch into: give --urdf FILE or --mujoco FILE, one of them"
        )
    changes = []
    if urdf is not None:
        changes = export_patch(patch, URDF, urdf, out)
    if mujoco is not None:
        changes = export_patch(patch, MUJOCO, mujoco, out)
    for change in changes:
        say(f"{urdf or mujoco}:{change.line}: {_words(change)}")
    number = f"{len(changes)} change{'' if len(changes) == 1 else 's'}"
    say(f"wrote {out}: {number}, in the units of the file; load it instead of {urdf or mujoco}")
    return 0


def _words(change: Change) -> str:
    """One line about a number: where it stands, what it was and what it is now."""
    if change.before is None:
        return f"{change.place}: {change.key} {change.after} (new)"
    return f"{change.place}: {change.key} {change.before} -> {change.after or 'none'}"
