# SPDX-License-Identifier: BSD-3-Clause
"""Effects of a patch that the compared model has from the beginning: checked whole, then cut to what was recorded."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from impedance_modules.diagnosis.data.model_file import ComparedModel
from impedance_modules.effects.catalogue import CATALOGUE
from impedance_modules.effects.patch_check import target_problems
from impedance_modules.effects.regressor import PAIR
from impedance_modules.effects.rigid_model import RigidModel
from impedance_modules.errors import BadFile
from impedance_modules.spec.patch_file import EffectSpec, read_patch


def read_known_effects(
    path: Path, compared: ComparedModel, note: Callable[[str], None]
) -> tuple[EffectSpec, ...]:
    """Reads the patch that is applied to the model before the diagnosis.

    What acts on joints or links that were not recorded, as on another arm, has no part in the residuals: it is left
    out, and the note says so.

    Args:
        path: The patch file.
        compared: The model of the recorded joints.
        note: Called with what is left out.

    Raises:
        BadInput: The file cannot be read.
        BadFile: It is for another robot, or does not fit catalogue or description; every problem with its place.
    """
    patch = read_patch(path)
    if patch.robot != compared.model.robot:
        message = f"the patch is for robot '{patch.robot}', the model is '{compared.model.robot}'"
        raise BadFile([patch.document.problem(("robot",), message)])
    problems = target_problems(patch, compared.target())
    if problems:
        raise BadFile(problems)
    joints = frozenset(compared.model.joints)
    links = frozenset(RigidModel.from_urdf(compared.urdf, compared.model.joints).bodies)
    known = []
    for spec in patch.effects:
        kept = {key: values for key, values in spec.parameters.items() if _recorded(spec, key, joints, links)}
        if left := [key for key in spec.parameters if key not in kept]:
            note(f"{path}: {spec.effect} of {', '.join(left)} is left out: the recordings do not move it")
        if kept:
            own = tuple(joint for joint in spec.joints if joint in joints)
            known.append(replace(spec, joints=own, parameters=kept))
    return tuple(known)


def _recorded(spec: EffectSpec, key: str, joints: frozenset[str], links: frozenset[str]) -> bool:
    """Says whether the part that carries a key's numbers is a recorded joint, or a link that one of them moves."""
    kinds = CATALOGUE[spec.effect].description.keys
    if "body" in kinds:
        return key in links
    return joints.issuperset(key.split(PAIR)) or not {"joint", "pair"} & set(kinds)
