# SPDX-License-Identifier: BSD-3-Clause
"""What ``check`` and ``run`` ask of a task before anything moves: the same questions, the same answers.

A run builds a solver, the distances of links and, unless a recording or a real robot takes its place, a plant, and
puts that at its start. Whatever they refuse comes from files and options alone, so it is asked here: all are built, as
Python, and thrown away. Then comes the prediction (``prediction.feasibility``).
"""

from __future__ import annotations

from impedance_modules.compiled import as_python
from impedance_modules.control.assembly import Assembly, make_distances, taught
from impedance_modules.errors import BadFile, BadInput, Problem
from impedance_modules.plant.step_stability import StepTooShort
from impedance_modules.prediction.feasibility import TaskPrediction, refuse_infeasible
from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.runs.task_plant import playback_plant, sim_backend
from impedance_modules.safety.solvers import make_solver
from impedance_modules.spec.document import Document, read_document
from impedance_modules.spec.locate import ROBOT_FILE


def accept(assembly: Assembly, *, plant: bool = True) -> TaskPrediction:
    """Refuses a task that a run would refuse, and predicts it; one with playback as its springs teach it.

    Args:
        assembly: The task.
        plant: Whether the built-in plant is the robot.

    Raises:
        BadFile: With the place in the task's, robot's or patch's file of every reason.
        BadInput: The robot's description cannot be built.
    """
    lesson = taught(assembly)
    with as_python():
        problems = _solver_problems(assembly)
        make_distances(lesson, Kinematics(lesson.model, lesson.modules.frames))
        if plant:
            problems += _plant_problems(assembly, lesson)
    if problems:
        raise BadFile(problems)
    return refuse_infeasible(lesson)


def _solver_problems(assembly: Assembly) -> list[Problem]:
    """Says at its line that the torque filter's solver cannot be used; the package's own always can."""
    if assembly.robot.solver in {"daqp", "proxsuite"}:
        return []
    try:
        make_solver(assembly.robot.solver)
    except BadInput as error:
        return [_robot_file(assembly).problem(("solver",), str(error))]
    return []


def _plant_problems(assembly: Assembly, lesson: Assembly) -> list[Problem]:
    """Puts the plant at its start, in each of the surroundings it is run in."""
    plants = [(lesson, sim_backend(lesson, 0).plant)]
    if assembly.task.playback is not None:
        plants.append((assembly, playback_plant(assembly, 0)))
    problems = []
    for asked, plant in plants:
        try:
            plant.refuse_start(asked.modules.posture)
        except StepTooShort as error:
            problems.append(_located(asked, error, taught_on=asked is lesson is not assembly))
    return problems


def _located(assembly: Assembly, error: StepTooShort, *, taught_on: bool) -> Problem:
    """Gives the line at which the number stands that makes a part too light or too stiff."""
    part, task = error.part, assembly.task.document
    if part.kind == "surface":
        above = ("playback", "taught_on") if taught_on else ("environment",)
        return task.problem((*above, part.index, "stiffness"), str(error))
    if part.kind == "joint":
        robot, name = _robot_file(assembly), assembly.model.joint_names[part.index]
        elastic = assembly.robot.joints[name].spring_stiffness is not None
        table = "reflected_inertia" if elastic else "motor_damping"
        short = (
            short
            for limb in assembly.robot.limbs.values()
            for short, own in limb.joints.items()
            if own == name
        )
        given = robot.data["joints"][table]
        return robot.problem(("joints", table, name if name in given else next(short)), str(error))
    return task.problem(("object", "mass" if part.kind == "object" else "hinge"), str(error))


def _robot_file(assembly: Assembly) -> Document:
    return read_document(assembly.robot.folder / ROBOT_FILE)
