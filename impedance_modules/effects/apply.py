# SPDX-License-Identifier: BSD-3-Clause
"""Applies a patch to a robot: the numbers that its model knows, and what only the plant does."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from impedance_modules.effects.catalogue import CATALOGUE
from impedance_modules.effects.effect import Effect, Values
from impedance_modules.effects.effect_description import Port
from impedance_modules.effects.object_inertia import OBJECT_KEY, ObjectInertia
from impedance_modules.effects.patch_check import numbers, patch_problems
from impedance_modules.effects.plant_builder import PlantBuilder, PlantEffects
from impedance_modules.effects.surface_effects import SurfaceEffect, surface_index
from impedance_modules.errors import BadFile, BadInput
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.patch_file import EffectSpec, PatchSpec
from impedance_modules.spec.robot_spec import RobotSpec
from impedance_modules.spec.task import ObjectSpec, SurfaceSpec


def apply_patch(robot: RobotSpec, patch: PatchSpec) -> RobotSpec:
    """Returns the robot as the patch describes it: the numbers that both model and plant use.

    Inertia (rotors, links, payload), springs (series and parallel), gravity's direction, and the largest
    command delay.

    Raises:
        BadFile: The patch does not fit the robot or the catalogue; every problem with its place.
        BadInput: What results is no physical robot.
    """
    problems = patch_problems(patch, robot)
    if problems:
        raise BadFile(problems)
    for effect, port, parameters in effects_of_patch(patch):
        robot = effect.apply_to_robot(robot, port, parameters)
    try:
        RobotModel(robot)
    except BadInput as error:
        raise BadInput(f"{patch.path}: {error}") from None
    return robot


def apply_to_plant(model: RobotModel, patch: PatchSpec) -> PlantEffects:
    """Returns what the plant of a robot does beyond its model.

    Args:
        model: Of the robot that ``apply_patch`` returned for the same patch.
        patch: Checked by ``apply_patch``.

    Raises:
        BadFile: An effect needs something that the robot lacks, e.g. a gap in a joint without a spring; every one.
    """
    builder, problems = PlantBuilder(model), []
    for place, (effect, port, parameters) in enumerate(effects_of_patch(patch)):
        try:
            effect.apply_to_plant(builder, port, parameters)
        except BadInput as error:
            problems.append(patch.document.problem(("effects", place, "effect"), str(error)))
    if problems:
        raise BadFile(problems)
    return builder.finish()


def apply_to_surfaces(surfaces: Sequence[SurfaceSpec], patch: PatchSpec) -> tuple[SurfaceSpec, ...]:
    """Returns a task's surfaces as they really are.

    Raises:
        BadFile: The patch has a surface that the task lacks; every problem with its place.
    """
    found, problems = list(surfaces), []
    for place, spec in enumerate(patch.effects):
        effect = CATALOGUE[spec.effect]
        if not isinstance(effect, SurfaceEffect):
            continue
        for key, quantities in spec.parameters.items():
            index = surface_index(key)
            if index is None or index >= len(found):
                has = (
                    ", ".join(f"surface{i}" for i in range(len(found))) or "none: the task has no environment"
                )
                where = ("effects", place, "parameters", key)
                problems.append(
                    patch.document.problem(where, f"the task has no surface '{key}'", (has,), "key")
                )
                continue
            found[index] = effect.apply_to_surface(found[index], numbers(quantities))
    if problems:
        raise BadFile(problems)
    return tuple(found)


def apply_to_object(held: ObjectSpec | None, patch: PatchSpec) -> ObjectSpec | None:
    """Returns a task's object as it really is; None of a task without one.

    Raises:
        BadFile: The patch has an object that the task lacks; every problem with its place.
    """
    if held is not None:
        return object_with(held, patch.effects)
    problems = [
        patch.document.problem(
            ("effects", place, "parameters", OBJECT_KEY),
            "no hand of the task holds an object",
            ("a task with 'object'",),
            "key",
        )
        for place, spec in enumerate(patch.effects)
        if isinstance(CATALOGUE[spec.effect], ObjectInertia)
    ]
    if problems:
        raise BadFile(problems)
    return None


def object_with(held: ObjectSpec, effects: Sequence[EffectSpec]) -> ObjectSpec:
    """Returns an object with the effects that change it; others are passed over."""
    for spec in effects:
        effect = CATALOGUE[spec.effect]
        if isinstance(effect, ObjectInertia):
            for quantities in spec.parameters.values():
                held = effect.apply_to_object(held, numbers(quantities))
    return held


def effects_of_patch(patch: PatchSpec) -> Iterator[tuple[Effect, Port, Mapping[str, Values]]]:
    """Walks through a checked patch: effect, port, and key -> symbol -> value."""
    for spec in patch.effects:
        effect = CATALOGUE[spec.effect]
        port = next(port for port in effect.description.ports if port == spec.port)
        yield effect, port, {key: numbers(quantities) for key, quantities in spec.parameters.items()}
