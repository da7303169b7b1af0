# SPDX-License-Identifier: BSD-3-Clause
"""What a task must pass before anything moves; ``run`` asks the same questions as ``check``."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.control.assembly import Assembly
from impedance_modules.errors import BadFile, Problem
from impedance_modules.prediction.compensation_forecast import (
    CompensationForecast,
    commanded,
    effort_at_rest,
    forecast_compensation,
)
from impedance_modules.prediction.energy_need import TankForecast, forecast_tank
from impedance_modules.prediction.inner_loop_limit import beyond_passive_gain
from impedance_modules.prediction.mechanism import Mechanism
from impedance_modules.prediction.obstacle_forecast import (
    NearestApproach,
    inside_at_start,
    inside_on_the_way,
    nearest_approaches,
)
from impedance_modules.prediction.passages import passage_problems
from impedance_modules.prediction.path_following import path_problems_of
from impedance_modules.prediction.phase_loops import PhaseLoops, judge_loops, unstable_loops
from impedance_modules.prediction.quasi_static import MotionPrediction, predict_motion
from impedance_modules.prediction.reach import (
    CourseAndRests,
    MissedTarget,
    missed_targets,
    reach_problems,
)
from impedance_modules.prediction.statics import Rest, find_rest
from impedance_modules.spec.submovement_spec import SUBMOVEMENTS, too_short
from impedance_modules.spec.task import Sine

NAMED_SHARE = 0.05
"""Share of the tank's need from which a cost is named."""


@dataclass(frozen=True)
class TaskPrediction:
    """What a task's feasibility is judged by.

    Attributes:
        motion: Its quasi-static prediction.
        rests: Where each phase comes to rest; None where one does not.
        tank: The energy it needs.
        loops: Of each phase: are they stable?
        compensation: What is compensated along it; None where nothing is.
        missed: Targets that are out of reach, but accepted.
        approaches: How near guarded frames come to obstacles.
    """

    motion: MotionPrediction
    rests: tuple[Rest | None, ...]
    tank: TankForecast
    loops: tuple[PhaseLoops, ...]
    compensation: CompensationForecast | None = None
    missed: tuple[MissedTarget, ...] = ()
    approaches: tuple[NearestApproach, ...] = ()


def refuse_infeasible(assembly: Assembly) -> TaskPrediction:
    """Refuses a task that cannot run as written; nothing has moved.

    A torque loop of the robot's own that is not passive; a sine or a submovement that the control rate cannot follow;
    hands or an object so deep inside a surface at the start that it pushes harder than the joints can; a frame inside
    an obstacle that guards it, at the start or on the way; a target out of reach; a path that begins elsewhere or is
    too fast for a joint; a torque beyond a joint's limit, in motion or at rest; a tank that holds less than the task
    needs; a loop that is unstable at this rate and delay, at a phase's rest or for too long on the way,
    unless it is allowed.

    Returns:
        What was predicted.

    Raises:
        BadFile: With the place in the task file of every reason.
    """
    mechanism = Mechanism(assembly)
    gain = [] if assembly.allow_unstable else beyond_passive_gain(assembly)
    at_start = [
        *gain,
        *_beyond_the_rate(assembly),
        *_pressed_at_start(assembly, mechanism),
        *inside_at_start(assembly, mechanism),
    ]
    if at_start:
        raise BadFile(at_start)
    motion, rests, missed = _within_reach(assembly, mechanism)
    compensation = forecast_compensation(assembly, mechanism, motion, rests)
    tank = forecast_tank(assembly, mechanism, motion, compensation)
    loops = judge_loops(assembly, mechanism, motion, rests)
    approaches = nearest_approaches(assembly, mechanism, motion)
    prediction = TaskPrediction(motion, rests, tank, loops, compensation, missed, approaches)
    problems = [
        *path_problems_of(assembly, motion),
        *inside_on_the_way(assembly, approaches),
        *_efforts_beyond_limits(assembly, prediction),
        *_need_beyond_tank(assembly, prediction.tank),
        *([] if assembly.allow_unstable else _unstable(assembly, mechanism, prediction)),
    ]
    if problems:
        raise BadFile(problems)
    return prediction


def _within_reach(
    assembly: Assembly, mechanism: Mechanism
) -> tuple[MotionPrediction, tuple[Rest | None, ...], tuple[MissedTarget, ...]]:
    """Predicts motion and rests, and refuses targets that are out of reach before anything else is said of them."""
    try:
        motion = predict_motion(assembly)
    except BadFile:
        _refuse_missed(assembly, missed_targets(assembly, None))
        raise
    rests = tuple(find_rest(mechanism, phase.setting, phase.q) for phase in motion.phases)
    missed = missed_targets(assembly, CourseAndRests(motion, rests))
    _refuse_missed(assembly, missed)
    return motion, rests, missed


def _refuse_missed(assembly: Assembly, missed: tuple[MissedTarget, ...]) -> None:
    problems = list(reach_problems(assembly, missed))
    if problems:
        raise BadFile(problems)


def _beyond_the_rate(assembly: Assembly) -> Iterator[Problem]:
    """Finds sines at or above half the rate that is used (Nyquist), and submovements too short for it."""
    highest = 0.5 * assembly.rate
    for index, phase in enumerate(assembly.task.phases):
        yield from _short_submovements(assembly, index)
        for target, coordinates in phase.equilibrium.items():
            for axis, coordinate in coordinates.items():
                if isinstance(coordinate, Sine) and coordinate.frequency >= highest:
                    yield assembly.task.document.problem(
                        ("phases", index, "equilibrium", target, axis, "sine", "frequency"),
                        f"{coordinate.frequency:g} Hz is not below half the control rate, {highest:g} Hz",
                    )


def _short_submovements(assembly: Assembly, index: int) -> Iterator[Problem]:
    """Finds a phase's submovements that are too short, where they stand in the file."""
    document = assembly.task.document
    for target in assembly.task.phases[index].submovements:
        at = ("phases", index, "equilibrium", target, SUBMOVEMENTS)
        for i, raw in enumerate(document.data["phases"][index]["equilibrium"][target][SUBMOVEMENTS]):
            if (why := too_short(float(raw["duration"]), assembly.rate)) is not None:
                yield document.problem((*at, i, "duration"), why)


def _pressed_at_start(assembly: Assembly, mechanism: Mechanism) -> Iterator[Problem]:
    """Finds surfaces in which hands or object begin so deep that no joint torque could hold them there."""
    mechanism.update(assembly.modules.posture, np.zeros(assembly.model.n))
    limit = assembly.limits.effort_max[mechanism.joints]
    names = [f"the hand '{arm.limb.hand}'" for arm in assembly.modules.arms] + ["the object"]
    contacts = mechanism.contacts(0.0)
    for index in range(len(assembly.task.environment)):
        inside = [(contact, J) for contact, J in contacts if contact.key[2] == index]
        if not inside:
            continue
        presses = [contact.surface.stiffness * contact.depth for contact, _ in inside]
        load = np.abs(
            np.sum([press * c.normal @ J for press, (c, J) in zip(presses, inside, strict=True)], axis=0)
        )
        worst, deepest = int(np.argmax(load / limit)), int(np.argmax(presses))
        if load[worst] > limit[worst]:
            contact = inside[deepest][0]
            joint = int(mechanism.joints[worst])
            yield assembly.task.document.problem(
                ("environment", index),
                f"{names[contact.key[0]]} begins {1e3 * contact.depth:.0f} mm inside this surface, which would push"
                f" with {presses[deepest]:.0f} N: {load[worst]:.0f} N.m on {assembly.model.joint_names[joint]}, whose"
                f" limit is {limit[worst]:g} N.m (valid: another posture, or the surface elsewhere)",
            )


def _unstable(assembly: Assembly, mechanism: Mechanism, prediction: TaskPrediction) -> list[Problem]:
    """Finds loops that are unstable where a phase comes to rest; if there are none, those on the way."""
    at_rest = list(unstable_loops(assembly, prediction.motion, prediction.loops))
    return at_rest or list(passage_problems(assembly, mechanism, prediction.motion))


def _efforts_beyond_limits(assembly: Assembly, prediction: TaskPrediction) -> Iterator[Problem]:
    """Finds joints whose commanded torque would pass the limit."""
    limit = assembly.limits.effort_max
    for index, phase in enumerate(prediction.motion.phases):
        demand = _demand(prediction, index)
        worst = int(np.argmax(demand / limit))
        if demand[worst] <= limit[worst]:
            continue
        alone = _demand(replace(prediction, compensation=None), index)
        if alone[worst] <= limit[worst]:
            yield _compensation_beyond_limit(assembly, prediction, phase.name, (alone, demand, worst))
        else:
            yield assembly.task.document.problem(
                ("phases", index),
                f"phase '{phase.name}' asks {demand[worst]:.1f} N.m of {assembly.model.joint_names[worst]},"
                f" whose limit is {limit[worst]:g} N.m: bring its equilibrium nearer, make its springs softer"
                " or its forces smaller",
            )


def _compensation_beyond_limit(
    assembly: Assembly, prediction: TaskPrediction, phase: str, torques: tuple[Array, Array, int]
) -> Problem:
    """Says which effect's compensation leaves a joint no torque, at its line in the patch."""
    alone, demand, worst = torques
    joint, limit = assembly.model.joint_names[worst], assembly.limits.effort_max[worst]
    found, forecast = assembly.compensation, prediction.compensation
    if found is None or forecast is None:
        raise ValueError("nothing is compensated, so nothing of it passes a limit")
    effect = forecast.strongest(joint)
    name = "the patch" if effect is None else effect.name
    path = ("effects",) if effect is None else ("effects", effect.place, "effect")
    return found.patch.document.problem(
        path,
        f"with {name} compensated, phase '{phase}' asks {demand[worst]:.1f} N.m of {joint}, {alone[worst]:.1f} N.m"
        f" without, whose limit is {limit:g} N.m (valid: a patch without it, or a task that asks for less)",
    )


def _demand(prediction: TaskPrediction, index: int) -> Array:
    """Gives the largest commanded torque of a phase, (n,) [N.m]."""
    phase, rest, added = prediction.motion.phases[index], prediction.rests[index], prediction.compensation
    efforts = commanded(prediction.motion, added, phase)
    if rest is not None:
        efforts.append(effort_at_rest(rest, added, index))
    return np.asarray(np.max(np.abs(efforts), axis=0))


def _need_beyond_tank(assembly: Assembly, tank: TankForecast) -> Iterator[Problem]:
    """Compares the energy that the task needs with what its tank holds at the start."""
    if tank.need <= assembly.tank.initial:
        return
    ranked = sorted(tank.costs.items(), key=lambda item: -item[1])
    named = [f"{name} {cost:.2f} J" for name, cost in ranked if cost > NAMED_SHARE * tank.need]
    yield assembly.task.document.problem(
        ("safety", "tank", "initial"),
        f"the task needs {tank.need:.2f} J in its tank, {assembly.tank.initial:g} J would slow it in phase"
        f" '{tank.phase}' (at {tank.time:.1f} s: {', '.join(named)}): fill the tank with at least the need or ask"
        " for less",
    )
