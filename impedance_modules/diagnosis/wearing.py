# SPDX-License-Identifier: BSD-3-Clause
r"""The model that wears a patch: numbers that an effect replaces are the model's own from then on; the others add.

A rotor that a patch says weighs I_a is the model's I_r: what recordings show beyond it is named as
I_r + (what was found), not as the robot file's number plus that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from impedance_modules.diagnosis.data.log import Log
from impedance_modules.diagnosis.data.nominal_model import NominalModel
from impedance_modules.spec.patch_file import EffectSpec

ROTOR, SPRING = "reflected_inertia", "joint_elasticity"
"""Effects that replace a number of the model."""


def wearing(
    model: NominalModel, worn: Sequence[EffectSpec], logs: Sequence[Log]
) -> tuple[NominalModel, tuple[EffectSpec, ...]]:
    """Puts into a model what a patch replaces there.

    Args:
        model: As the robot file has it.
        worn: Effects of the patch.
        logs: The recordings; without a joint sensor springs of the model do not count, and a patch's adds.

    Returns:
        The model, and the effects that add to it.
    """
    replaced = {ROTOR, SPRING} if logs[0].effort_source == "joint_sensor" else {ROTOR}
    for spec in worn:
        if spec.effect in replaced:
            model = _with(model, spec)
    return model, tuple(spec for spec in worn if spec.effect not in replaced)


def _with(model: NominalModel, spec: EffectSpec) -> NominalModel:
    """One effect's numbers in a model; joints that were not recorded count for nothing."""
    inertia, compliance, damping = (
        values.copy() for values in (model.reflected_inertia, model.compliance, model.spring_damping)
    )
    for name, symbols in spec.parameters.items():
        if name not in model.joints:
            continue
        joint = model.joints.index(name)
        if spec.effect == ROTOR:
            inertia[joint] = symbols["Ia"].value
        else:
            compliance[joint] = 1.0 / symbols["K"].value
            damping[joint] = symbols["D"].value if "D" in symbols else damping[joint]
    return replace(model, reflected_inertia=inertia, compliance=compliance, spring_damping=damping)
