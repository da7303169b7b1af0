# SPDX-License-Identifier: BSD-3-Clause
"""Reads a task file: YAML, schema, meaning; every fault at once, or a TaskSpec and its RobotSpec."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from impedance_modules.errors import BadFile, BadInput, Problem
from impedance_modules.spec.between_spec import BETWEEN, build_between
from impedance_modules.spec.build_task import (
    build_object,
    build_phase,
    build_playback,
    build_push,
    build_scale,
    build_surface,
    build_tank,
)
from impedance_modules.spec.check_arms import arm_problems
from impedance_modules.spec.check_between import between_problems
from impedance_modules.spec.check_hinge import half_turn_problems, hinge_problems
from impedance_modules.spec.check_obstacles import obstacle_problems
from impedance_modules.spec.check_phases import phase_problems
from impedance_modules.spec.check_springs import spring_problems
from impedance_modules.spec.check_surroundings import (
    object_problems,
    playback_problems,
    push_problems,
    surface_problems,
    tank_problems,
    wood_problems,
)
from impedance_modules.spec.document import Document, scan_document
from impedance_modules.spec.locate import find_robot, find_task
from impedance_modules.spec.obstacle_spec import OBSTACLES, build_obstacle
from impedance_modules.spec.other_robot import on_robot
from impedance_modules.spec.robot_reader import read_robot
from impedance_modules.spec.robot_spec import RobotSpec
from impedance_modules.spec.robot_words import FilledIn, fill_in, tie_problems
from impedance_modules.spec.schema import schema_faults
from impedance_modules.spec.set_point_limits import build_set_point_limits
from impedance_modules.spec.surface_mesh import mesh_path, read_mesh
from impedance_modules.spec.task import SurfaceSpec, TaskPlayback, TaskSpec
from impedance_modules.spec.task_draft import DraftArm, TaskDraft, draft_arms
from impedance_modules.spec.urdf import UrdfFacts, read_urdf

RobotReader = Callable[[Path], RobotSpec]
"""Reads the robot in a folder."""


def read_task(
    name_or_path: str | Path, robot_reader: RobotReader = read_robot, *, robot: str | None = None
) -> tuple[TaskSpec, RobotSpec]:
    """Reads a task and the robot it names, or another one.

    Args:
        name_or_path: A path, or the name of a shipped task; a path wins.
        robot_reader: Reads the robot's folder.
        robot: Name or folder of the robot that it shall run on; None for the one that it names.

    Raises:
        BadInput: There is no such task, or it is no text file.
        BadFile: The task, or the robot it names, has faults; all of them at once. Or it names joints, links or
            numbers of its own robot and shall run on another.
    """
    document = scan_document(find_task(name_or_path))
    if robot is None:
        return check_task(document, robot_reader)
    changed = on_robot(document, robot)
    own, other = (_robot_name(one) for one in (document, changed))
    if own != other:
        problems = [
            *tie_problems(document, robot_reader(find_robot(changed.data["robot"], document.path)), own)
        ]
        if problems:
            raise BadFile(problems)
    return check_task(changed, robot_reader)


def _robot_name(document: Document) -> str:
    """The folder's name of the robot that a task names, which is the robot's."""
    return Path(str(document.data.get("robot"))).name


def check_task(document: Document, robot_reader: RobotReader = read_robot) -> tuple[TaskSpec, RobotSpec]:
    """Like ``read_task``, for a document that has been scanned already."""
    deviations = schema_faults(document, "task")
    misread = {place for place, _, _ in document.faults}
    problems = [*document.yaml_problems, *(p for p, _ in deviations if (p.line, p.column) not in misread)]
    broken = (*(path for _, path, _ in document.faults), *(path for _, path in deviations))
    robot, urdf = None, None
    try:
        robot, urdf = _read_robot(document, robot_reader)
    except BadFile as error:
        problems += error.problems
    filled = FilledIn(document) if robot is None or urdf is None else fill_in(document, robot, urdf.links)
    draft = TaskDraft(filled.document, broken, robot, urdf, filled.images)
    arms = draft_arms(draft)
    problems += [*filled.problems, *_meaning_problems(draft, arms)]
    if problems or robot is None:
        raise BadFile(problems)
    return _finished(filled.document, arms, document), robot


def _read_robot(document: Document, robot_reader: RobotReader) -> tuple[RobotSpec | None, UrdfFacts | None]:
    """Reads the robot that a task names; None where the name itself is at fault and already reported."""
    name = document.data.get("robot")
    if not isinstance(name, str) or not name:
        return None, None
    try:
        robot = robot_reader(find_robot(name, beside=document.path))
        return robot, read_urdf(robot.urdf)
    except BadFile:
        raise
    except BadInput as error:
        raise BadFile([document.problem(("robot",), str(error))]) from None


def _meaning_problems(draft: TaskDraft, arms: Mapping[str, DraftArm]) -> Iterator[Problem]:
    yield from _mode_problems(draft)
    yield from arm_problems(draft, arms)
    yield from spring_problems(draft, arms)
    yield from between_problems(draft)
    yield from obstacle_problems(draft)
    yield from object_problems(draft, arms)
    yield from hinge_problems(draft)
    yield from half_turn_problems(draft)
    yield from tank_problems(draft)
    yield from surface_problems(draft)
    yield from push_problems(draft)
    yield from playback_problems(draft)
    yield from wood_problems(draft)
    yield from phase_problems(draft, arms)


def _mode_problems(draft: TaskDraft) -> Iterator[Problem]:
    """The robot of a task takes torques: springs command nothing else."""
    robot = draft.robot
    if robot is not None and "torque" not in robot.control_modes:
        takes = ", ".join(robot.control_modes)
        message = f"robot '{robot.name}' takes no torque commands: its control_modes are {takes}"
        yield draft.document.problem(("robot",), message, ("a robot whose control_modes name torque",))


def _finished(document: Document, arms: Mapping[str, DraftArm], written: Document) -> TaskSpec:
    """The TaskSpec of a document in which nothing is wrong; ``written`` is the file as it stands."""
    data = document.data
    limits = build_set_point_limits(data["set_points"]) if "set_points" in data else None
    return TaskSpec(
        name=data["name"],
        description=data.get("description", ""),
        robot=data["robot"],
        arms={name: arm.finished() for name, arm in arms.items()},
        object=build_object(data["object"]) if "object" in data else None,
        tank=build_tank(data["safety"]["tank"]),
        environment=_surfaces(document, data.get("environment", [])),
        pushes=tuple(build_push(raw) for raw in data.get("pushes", [])),
        phases=tuple(
            build_phase(raw, () if limits is None else tuple(limits.targets)) for raw in data["phases"]
        ),
        path=document.path,
        text=document.text,
        document=written,
        playback=_playback(document) if "playback" in data else None,
        set_points=limits,
        between=tuple(build_between(raw) for raw in data.get(BETWEEN, [])),
        obstacles=tuple(build_obstacle(raw) for raw in data.get(OBSTACLES, [])),
    )


def _playback(document: Document) -> TaskPlayback:
    raw = document.data["playback"]
    return replace(build_playback(raw), taught_on=_surfaces(document, raw["taught_on"]))


def _surfaces(document: Document, given: Sequence[Mapping[str, Any]]) -> tuple[SurfaceSpec, ...]:
    """Makes surfaces, meshes with their triangles."""
    surfaces = []
    for raw in given:
        surface = build_surface(raw)
        if "file" in raw:
            path = mesh_path(document.path, raw["file"])
            surface = replace(surface, mesh=read_mesh(path, raw["file"], build_scale(raw)))
        surfaces.append(surface)
    return tuple(surfaces)
