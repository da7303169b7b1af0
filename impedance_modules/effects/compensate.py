# SPDX-License-Identifier: BSD-3-Clause
"""What a controller adds against the effects of a patch; what it cannot take back is refused at its line."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from impedance_modules.effects.catalogue import CATALOGUE
from impedance_modules.effects.compensation_builder import (
    CompensationBuilder,
    CompensationNumbers,
    Diagnosed,
    IdentifiedNumber,
)
from impedance_modules.effects.effect import Compensation, Effect
from impedance_modules.effects.patch_check import patch_problems
from impedance_modules.errors import BadFile, BadInput
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.patch_file import EffectSpec, PatchQuantity, PatchSpec
from impedance_modules.spec.robot_spec import RobotSpec

IN_WORDS: Mapping[Compensation, str] = {
    "weight": "a torque with a potential, dV/dq of what weighs more",
    "potential": "a torque with a potential, of the joint alone",
    "friction": "its least torque along the desired motion; the tank pays",
    "gain": "the torque asked for is divided by the end of the interval that is nearer to 1",
}

POTENTIALS: frozenset[Compensation] = frozenset({"weight", "potential"})
"""Kinds whose torque is the gradient of an energy; the work of all others is paid from the tank."""


@dataclass(frozen=True)
class CompensatedEffect:
    """One effect of a patch that the controller compensates.

    Attributes:
        place: In the patch's list of effects.
        name: Of the effect.
        keys: Joints, links or ``base`` that it belongs to.
        kind: How it is taken back.
        numbers: What this effect alone adds.
    """

    place: int
    name: str
    keys: tuple[str, ...]
    kind: Compensation
    numbers: CompensationNumbers

    @property
    def has_potential(self) -> bool:
        """Whether its torque is the gradient of an energy."""
        return self.kind in POTENTIALS


@dataclass(frozen=True)
class PatchCompensation:
    """What the controller adds against a whole patch.

    Attributes:
        patch: The patch.
        model: The robot as it is described, without any patch: what its own weight compensation knows.
        effects: Each of them by itself.
        numbers: All together.
    """

    patch: PatchSpec
    model: RobotModel
    effects: tuple[CompensatedEffect, ...]
    numbers: CompensationNumbers


def compensate_patch(robot: RobotSpec, patch: PatchSpec) -> PatchCompensation:
    """Finds what a controller adds against the effects of a patch.

    Args:
        robot: As it is described, without any patch.
        patch: What was diagnosed.

    Raises:
        BadFile: The patch does not fit the robot, or an effect cannot be compensated; every problem with its place.
    """
    problems = patch_problems(patch, robot)
    if problems:
        raise BadFile(problems)
    model = RobotModel(robot)
    together, alone = CompensationBuilder(model), []
    for place, spec in enumerate(patch.effects):
        effect = CATALOGUE[spec.effect]
        try:
            kind = _kind(spec)
            by_itself = CompensationBuilder(model)
            for builder in (by_itself, together):
                effect.compensate(builder, _diagnosed(spec))
            numbers = by_itself.finish()
            if numbers.robot is not None:
                RobotModel(numbers.robot)
        except BadInput as error:
            problems.append(patch.document.problem(("effects", place, "effect"), str(error)))
            continue
        alone.append(CompensatedEffect(place, spec.effect, tuple(spec.parameters), kind, numbers))
    if problems:
        raise BadFile(problems)
    return PatchCompensation(patch, model, tuple(alone), together.finish())


def compensation_words(effect: Effect) -> str:
    """Says how a controller takes an effect back, and what is refused."""
    refused = [port for port in effect.description.ports if port not in effect.compensated_at]
    if effect.compensation is None:
        return f"refused: {effect.not_compensated}"
    words = IN_WORDS[effect.compensation]
    return f"{words}; at the {', '.join(refused)} refused: {effect.not_compensated}" if refused else words


def _kind(spec: EffectSpec) -> Compensation:
    """Says how an effect is taken back; ``BadInput`` says why it is not."""
    effect = CATALOGUE[spec.effect]
    if effect.compensation is not None and spec.port in effect.compensated_at:
        return effect.compensation
    where = f" at port '{spec.port}'" if effect.compensation is not None else ""
    raise BadInput(f"{spec.effect}{where} is not compensated: {effect.not_compensated}")


def _diagnosed(spec: EffectSpec) -> Diagnosed:
    numbers = {
        key: {symbol: _identified(quantity) for symbol, quantity in quantities.items()}
        for key, quantities in spec.parameters.items()
    }
    speeds: Mapping[str, tuple[float, float]] = spec.range.get("velocity", {})
    return Diagnosed(numbers, speeds)


def _identified(quantity: PatchQuantity) -> IdentifiedNumber:
    return IdentifiedNumber(quantity.value, 0.0 if quantity.std is None else quantity.std)
