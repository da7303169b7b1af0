# SPDX-License-Identifier: BSD-3-Clause
"""What the held object, surfaces, pushes, the energy tank and playback must fulfil beyond their schema."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping

from impedance_modules.errors import BadInput, Problem, nearest
from impedance_modules.spec.build_task import (
    build_object,
    build_push,
    build_scale,
    build_surface,
    build_tank,
    build_wood,
)
from impedance_modules.spec.surface_mesh import mesh_faults, mesh_path, read_mesh
from impedance_modules.spec.task import ObjectSpec
from impedance_modules.spec.task_draft import DraftArm, TaskDraft

LARGEST_WOOD = 1.0
"""Largest wooden area that the plant simulates [m^2]."""

CLOSEST_SUPPORTS = 1e-3
"""Between two supports of a sheet [m]; the plane between closer ones would only be noise."""


def object_problems(draft: TaskDraft, arms: Mapping[str, DraftArm]) -> Iterator[Problem]:
    """Checks who holds the object and where it starts."""
    names = draft.keys("arms")
    for i in draft.count("object", "held_by"):
        name = draft.value("object", "held_by", i)
        at = ("object", "held_by", i)
        if isinstance(name, str) and name not in names:
            yield draft.problem(at, f"there is no arm '{name}' in this file{nearest(name, names)}", names)
        elif isinstance(name, str) and name in arms and (missing := _without_hand_spring(draft, arms[name])):
            yield draft.problem(at, missing)
    if draft.clean("object"):
        held = build_object(draft.value("object"))
        if held.squeeze > 0.0 and len(held.held_by) < 2:
            message = "a squeeze needs two hands that press against each other; 'held_by' names one"
            yield draft.problem(("object", "squeeze"), message)
        yield from _start_problems(draft, held)


def tank_problems(draft: TaskDraft) -> Iterator[Problem]:
    """Checks floor < initial <= max."""
    at = ("safety", "tank")
    if not draft.clean(*at):
        return
    tank = build_tank(draft.value(*at))
    if tank.initial > tank.max:
        yield draft.problem(
            (*at, "initial"), f"{tank.initial:g} J is more than the tank holds, max: {tank.max:g} J"
        )
    if tank.floor >= tank.initial:
        message = f"the floor, {tank.floor:g} J, must be less than the initial energy, {tank.initial:g} J"
        yield draft.problem((*at, "floor"), message)


def surface_problems(draft: TaskDraft) -> Iterator[Problem]:
    """Checks that the supports of every sheet lie one after the other, far enough for a gentle sheet between.

    And that the file of every mesh can be read and holds a closed body.
    """
    for place in (("environment",), ("playback", "taught_on")):
        for i in draft.count(*place):
            kind = draft.value(*place, i, "surface") if draft.clean(*place, i) else None
            if kind == "sheet":
                yield from _support_problems(draft, (*place, i, "supports"))
            elif kind == "mesh":
                yield from _mesh_problems(draft, (*place, i))


def push_problems(draft: TaskDraft) -> Iterator[Problem]:
    """Checks that what is pushed is there, and that the run does not end before the push begins."""
    targets = (*draft.keys("arms"), *(("object",) if draft.has("object") else ()))
    lasts = _longest(draft)
    for i in draft.count("pushes"):
        if not draft.clean("pushes", i):
            continue
        push = build_push(draft.value("pushes", i))
        if push.target not in targets:
            message = (
                f"there is nothing to push called '{push.target}' in this file{nearest(push.target, targets)}"
            )
            yield draft.problem(("pushes", i, "target"), message, targets)
        if lasts is not None and push.start >= lasts:
            message = f"the push begins at {push.start:g} s, but all phases are over after {lasts:g} s"
            yield draft.problem(("pushes", i, "start"), message)


def playback_problems(draft: TaskDraft) -> Iterator[Problem]:
    """Checks that the robot plays anything back, and that nothing is asked that a playback does not do."""
    if not draft.has("playback"):
        return
    if draft.robot is not None and draft.robot.playback is None:
        message = f"robot '{draft.robot.name}' plays nothing back: its robot.yaml has no 'playback'"
        yield draft.problem(("playback",), message)
    for key, what in (("object", "holds no object"), ("pushes", "is not pushed")):
        if draft.has(key):
            message = f"a robot that plays a path back {what} here; leave out 'playback' or '{key}'"
            yield draft.problem((key,), message)


def wood_problems(draft: TaskDraft) -> Iterator[Problem]:
    """Checks that every piece of wood is small enough to simulate, and its forces are in order."""
    for i in draft.count("environment"):
        at = ("environment", i, "wood")
        if not (draft.clean(*at) and draft.clean("environment", i, "size")):
            continue
        size, wood = draft.value("environment", i, "size"), build_wood(draft.value(*at))
        if size[0] * size[1] > LARGEST_WOOD:
            message = (
                f"wood of {size[0]:g} m x {size[1]:g} m is larger than the plant can simulate; valid: a top "
                f"face of at most {LARGEST_WOOD:g} m^2"
            )
            yield draft.problem(at, message, at="key")
        if wood.splinters is not None and wood.splinters.force[0] > wood.splinters.force[1]:
            low, high = wood.splinters.force
            message = f"the least breaking force, {low:g} N, is above the largest, {high:g} N"
            yield draft.problem((*at, "splinters", "force"), message)


def _without_hand_spring(draft: TaskDraft, arm: DraftArm) -> str:
    """An arm moves and squeezes an object through a spring on its hand."""
    limb = draft.limb(arm.name)
    read_all = len(arm.springs) == len(draft.count("arms", arm.mirror_of or arm.name, "springs"))
    if limb is None or not read_all or any(spring.frame == limb.hand for spring in arm.springs.values()):
        return ""
    return f"the arm '{arm.name}' holds the object but has no spring on its hand '{limb.hand}'"


def _start_problems(draft: TaskDraft, held: ObjectSpec) -> Iterator[Problem]:
    """The object's origin must not begin below a level plane."""
    for i in draft.count("environment"):
        if held.position is None or not draft.clean("environment", i):
            continue
        surface = build_surface(draft.value("environment", i))
        if surface.height is not None and not any(surface.rotation) and held.position[2] < surface.height:
            message = (
                f"the object's origin starts at z = {held.position[2]:g} m, below the plane environment[{i}] "
                f"at {surface.height:g} m"
            )
            yield draft.problem(("object", "position", 2), message)


def _mesh_problems(draft: TaskDraft, at: tuple[str | int, ...]) -> Iterator[Problem]:
    raw = draft.value(*at)
    path = mesh_path(draft.document.path, raw["file"])
    try:
        mesh = read_mesh(path, raw["file"], build_scale(raw))
    except BadInput as error:
        yield draft.problem((*at, "file"), str(error))
        return
    for fault in mesh_faults(mesh):
        yield draft.problem((*at, "file"), f"{path} {fault}")


def _support_problems(draft: TaskDraft, at: tuple[str | int, ...]) -> Iterator[Problem]:
    supports = [(float(raw["at"]), float(raw["height"])) for raw in draft.value(*at)]
    for k, ((before, low), (place, high)) in enumerate(itertools.pairwise(supports), start=1):
        if place - before < CLOSEST_SUPPORTS:
            message = (
                f"this support, at {place:g} m, must lie at least {CLOSEST_SUPPORTS:g} m beyond the one before, "
                f"at {before:g} m"
            )
            yield draft.problem((*at, k, "at"), message)
        elif abs(high - low) > place - before:
            message = (
                f"the sheet would rise by {high - low:g} m over {place - before:g} m; its equation holds for "
                "slopes up to 1: set the supports further apart"
            )
            yield draft.problem((*at, k, "height"), message)


def _longest(draft: TaskDraft) -> float | None:
    """Adds up the durations of all phases [s]; None where one of them is not sound."""
    if not draft.clean("phases"):
        return None
    return sum(float(draft.value("phases", i, "duration")) for i in draft.count("phases"))
