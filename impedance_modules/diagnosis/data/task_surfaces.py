# SPDX-License-Identifier: BSD-3-Clause
"""What the hands of a recording could touch, as its task has it: the environment's surfaces, and a held object."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from impedance_modules.effects.catalogue import CATALOGUE
from impedance_modules.effects.surface_effects import SurfaceEffect, surface_index
from impedance_modules.errors import ImpedanceError
from impedance_modules.spec.build_task import build_surface
from impedance_modules.spec.document import parse_document
from impedance_modules.spec.patch_file import EffectSpec
from impedance_modules.spec.schema import schema_faults
from impedance_modules.spec.task import SurfaceSpec

ANY_HAND = "hand"
"""Word of a task for the hand of the limb, whatever the robot calls it."""


@dataclass(frozen=True)
class TaskSurfaces:
    """A task's environment.

    Attributes:
        surfaces: In the task's order.
        hands: Links whose origins touch them.
        holds: Whether the hands hold an object, which touches in their place.
    """

    surfaces: tuple[SurfaceSpec, ...]
    hands: tuple[str, ...]
    holds: bool


def task_surfaces_of(text: str, limbs: Mapping[str, str]) -> TaskSurfaces | None:
    """Reads the environment of a task.

    Args:
        text: The task file's whole text, as recordings keep it.
        limbs: Limb -> its hand, by the robot's file; empty for a robot known by its description alone.

    Returns:
        None of a text that is no task, or of a task without an environment.
    """
    data = task_data(text)
    if data is None:
        return None
    surfaces = tuple(build_surface(raw) for raw in data.get("environment", []))
    hands = tuple(dict.fromkeys(_hands(data["arms"], limbs)))
    return TaskSurfaces(surfaces, hands, "object" in data) if surfaces and hands else None


def task_data(text: str) -> Any | None:
    """Reads what a recording keeps of its task; None of a text that is no task."""
    if not text:
        return None
    try:
        document = parse_document(Path("task"), text)
    except ImpedanceError:
        return None
    return None if document.faults or schema_faults(document, "task") else document.data


def with_known_surfaces(surroundings: TaskSurfaces, known: Sequence[EffectSpec]) -> TaskSurfaces:
    """Applies the known effects of a patch to the surfaces; effects on others than the task's are ignored."""
    surfaces = list(surroundings.surfaces)
    for spec in known:
        effect = CATALOGUE[spec.effect]
        if not isinstance(effect, SurfaceEffect):
            continue
        for key, symbols in spec.parameters.items():
            index = surface_index(key)
            if index is not None and index < len(surfaces):
                values = {symbol: quantity.value for symbol, quantity in symbols.items()}
                surfaces[index] = effect.apply_to_surface(surfaces[index], values)
    return replace(surroundings, surfaces=tuple(surfaces))


def _hands(arms: Mapping[str, Any], limbs: Mapping[str, str]) -> Iterator[str]:
    for name, arm in arms.items():
        if name in limbs:
            yield limbs[name]
        else:
            yield from (spring["frame"] for spring in arm.get("springs", []) if spring["frame"] != ANY_HAND)
