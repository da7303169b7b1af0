# SPDX-License-Identifier: BSD-3-Clause
"""The object that a recording's task has: who holds it, and in which samples it is in the hands and nowhere else.

In simulation, and where a task orders no grippers, the hands hold it from the first sample. A robot that takes it up
with a gripper holds it from the end of the phase that closes the fingers to the begin of the one that opens them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.data.task_surfaces import task_data
from impedance_modules.effects.apply import object_with
from impedance_modules.episode.data import Episode
from impedance_modules.spec.build_task import build_object
from impedance_modules.spec.gripper_spec import CLOSE
from impedance_modules.spec.patch_file import EffectSpec
from impedance_modules.spec.task import ObjectSpec

Mask = NDArray[np.bool_]

SIMULATED = ("sim", "mujoco")
"""Backends in which an object is in the hands from the start, whatever their fingers do."""


@dataclass(frozen=True, eq=False)
class TaskObject:
    """The object of a recording's task.

    Attributes:
        spec: As the task has it.
        hands: Links that hold it rigidly, by welds.
        start: (n,) joints' positions at the begin of the recording, where the grasps were taken [rad].
        picked: Fingers take it up during the recording: it stands somewhere before and afterwards.
    """

    spec: ObjectSpec
    hands: tuple[str, ...]
    start: Array
    picked: bool

    def with_known(self, known: Sequence[EffectSpec]) -> TaskObject:
        """Applies the known effects of a patch to the object."""
        return replace(self, spec=object_with(self.spec, known))


def task_object_of(episode: Episode, limbs: Mapping[str, str], joints: Sequence[str]) -> TaskObject | None:
    """Finds what a recording's hands hold.

    Args:
        episode: The recording, or a segment of one.
        limbs: Limb -> its hand, by the robot's file.
        joints: Order of the positions.

    Returns:
        None without a task, without an object that hands hold rigidly, without the robot's file, or where the segment
        does not begin where the recording does.
    """
    data = task_data(str(episode.metadata.get("task") or ""))
    if data is None or "object" not in data or episode.time[0] > 1.0:
        return None
    spec = build_object(data["object"])
    if spec.grasp != "weld" or spec.hinge is not None or any(name not in limbs for name in spec.held_by):
        return None
    position = episode.matrix("position", joints)
    if position is None or not spec.held_by:
        return None
    hands = tuple(limbs[name] for name in spec.held_by)
    return TaskObject(spec, hands, np.asarray(position[0]), _is_picked(episode, data))


def carrying(episode: Episode, time: Array, touching: Mask | None) -> Mask | None:
    """Marks the times (N,) at which hands hold the task's object for certain, and neither they nor it touch anything.

    Args:
        episode: The recording.
        time: Of the samples [s].
        touching: (N,) in contact with surroundings, by the phases; None for never.
    """
    data = task_data(str(episode.metadata.get("task") or ""))
    if data is None or "object" not in data or episode.phase is None:
        return None
    if data.get("environment") and not any(_awaits_contact(phase) for phase in data["phases"]):
        return None  # it could touch a surface at any time
    held = _phases_held(data) if _is_picked(episode, data) else {str(p["name"]) for p in data["phases"]}
    marks = np.array([phase in held for phase in episode.phase], dtype=bool)
    nearest = np.searchsorted(episode.time, time - 1e-9).clip(0, len(marks) - 1)
    found = marks[nearest] if touching is None else marks[nearest] & ~touching
    return np.asarray(found) if found.any() else None


def _awaits_contact(phase: Any) -> bool:
    return "contact" in (phase.get("until") or {})


def _is_picked(episode: Episode, data: Any) -> bool:
    """Whether fingers take the object up during the recording."""
    holders = set(data["object"]["held_by"])
    ordered = any(holders & set(phase.get("grippers") or {}) for phase in data["phases"])
    return ordered and episode.metadata.get("backend") not in SIMULATED


def _phases_held(data: Any) -> set[str]:
    """Names the phases after one that closes a holder's gripper, up to the next other order for it."""
    holders, held, found = set(data["object"]["held_by"]), False, set()
    for phase in data["phases"]:
        orders = [order for limb, order in (phase.get("grippers") or {}).items() if limb in holders]
        closes = any(isinstance(order, dict) and CLOSE in order for order in orders)
        held = held and not orders
        if held:
            found.add(str(phase["name"]))
        held = held or closes
    return found
