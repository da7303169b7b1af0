# SPDX-License-Identifier: BSD-3-Clause
"""Carries a whole patch into a file, or says of every effect that cannot be carried why not, and writes nothing."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from impedance_modules.effects.apply import effects_of_patch
from impedance_modules.effects.patch_check import target_problems
from impedance_modules.effects.simulator_numbers import Amount, combined
from impedance_modules.errors import BadFile, BadInput, Problem
from impedance_modules.export.carrier import D, Format, NotCarried
from impedance_modules.export.edited_xml import Change
from impedance_modules.spec.patch_file import PatchSpec, read_patch


def export_patch(patch: Path, format_: Format[D], file: Path, out: Path) -> list[Change]:
    """Writes a robot's description with a patch in it.

    Args:
        patch: The patch file.
        format_: What the description is.
        file: The description; it is not changed.
        out: Where the new one goes.

    Returns:
        What differs, in the file's order.

    Raises:
        BadInput: A file cannot be read or written.
        BadFile: Patch and description do not fit, or an effect cannot be carried; every problem with its place.
    """
    for path in (file, patch):
        if out.resolve() == path.resolve():
            raise BadInput(f"--out {out}: that file is read and stays as it is (valid: another file)")
    spec = read_patch(patch)
    description = format_.read(file, out)
    misnamed = target_problems(spec, description.target)
    refused = [*_without_a_place(spec, format_), *([] if misnamed else _carry(spec, format_, description))]
    problems = [*misnamed, *refused, *description.faults.problems]
    if problems:
        raise BadFile(problems)
    _save(out, description.xml.written())
    return list(description.xml.changes())


def _without_a_place(patch: PatchSpec, format_: Format[D]) -> Iterator[Problem]:
    """Lists the effects that are none of the numbers of a format."""
    for index, (effect, port, _) in enumerate(effects_of_patch(patch)):
        parts = [part for part in effect.exported if part.acts_at(port)]
        reasons = [format_.refused[part.quantity] for part in parts if part.quantity in format_.refused]
        for reason in reasons if parts else [effect.not_exported]:
            yield _problem(patch, format_, index, reason)


def _carry(patch: PatchSpec, format_: Format[D], description: D) -> Iterator[Problem]:
    """Writes what a format has a place for; yields what this very file has none for."""
    amounts = combined(list(_amounts(patch)))
    present = {(amount.quantity, amount.key) for amount in amounts}
    for amount in amounts:
        carrier = format_.carriers.get(amount.quantity)
        beside = (
            reason
            for (quantity, other), reason in format_.apart.items()
            if quantity == amount.quantity and (other, amount.key) in present
        )
        try:
            if (reason := next(beside, None)) is not None:
                raise NotCarried(reason)
            if carrier is not None:
                carrier.write(description, amount)
        except NotCarried as why:
            for index in amount.effects:
                yield _problem(patch, format_, index, str(why))


def _amounts(patch: PatchSpec) -> Iterator[Amount]:
    """Walks through what a patch changes, effect by effect."""
    for index, (effect, port, parameters) in enumerate(effects_of_patch(patch)):
        for part in effect.exported:
            for key, values in parameters.items():
                numbers = tuple(float(value) for value in part.numbers(values))
                if part.acts_at(port) and numbers:
                    yield Amount(part.quantity, key, numbers, (index,))


def _problem(patch: PatchSpec, format_: Format[D], index: int, reason: str) -> Problem:
    effect = patch.effects[index].effect
    message = f"{effect} cannot become part of {format_.words}: {reason}"
    return patch.document.problem(("effects", index, "effect"), message)


def _save(out: Path, text: bytes) -> None:
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_bytes(text)
    except OSError as error:
        raise BadInput(f"{out}: cannot be written: {error.strerror} (valid: a writable place)") from error
