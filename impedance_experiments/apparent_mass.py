# SPDX-License-Identifier: BSD-3-Clause
r"""Apparent mass of a hand: computed for the thesis's planar arm, and measured at a surface that the hand hits (3.3).

    \Lambda^-1 = J (M + I_r)^-1 J^T        along a normal n: m = 1 / (n^T \Lambda^-1 n)

What a surface measures is the impulse over the change of the hand's speed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from impedance_experiments.task_run import watch_task
from impedance_modules.arrays import Array
from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.control.supervisor import Supervisor
from impedance_modules.errors import BadInput
from impedance_modules.plant.plant import Plant
from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.state import RobotState
from impedance_modules.safety.limits import FilterLimits
from impedance_modules.spec.task_reader import read_task

TASK = "impact"
"""The thesis's planar arm comes down on a table at 0.1 m/s."""
WITHOUT_ROTORS = Path("patches", "without-reflected-inertia.yaml")
"""Patch that makes every joint an ideal torque source, in the robot's folder."""
RELATIVE = (3 * math.pi / 4, 3 * math.pi / 4, math.pi / 2)
"""The stated angles, taken as angles of the joints [rad]."""
ABSOLUTE = (3 * math.pi / 4, 0.0, -math.pi / 4)
"""The stated angles, taken as angles of the links against the ground [rad], as the caption says."""


@dataclass(frozen=True)
class Impact:
    """The first touch of a run.

    Attributes:
        stiffness: Of the surface [N/m].
        speed: Of the hand towards the surface when it arrives [m/s].
        left: The same when the force is gone, away from it [m/s].
        time: (m,) since the touch [s].
        force: (m,) normal force [N].
        mass: Predicted apparent mass along the normal, 1 / (n^T J (M + I_r)^-1 J^T n) [kg].
    """

    stiffness: float
    speed: float
    left: float
    time: Array
    force: Array
    mass: float

    @property
    def duration(self) -> float:
        """How long the hand stays [s]."""
        return float(self.time[-1])

    @property
    def peak(self) -> float:
        """Largest force [N]."""
        return float(np.max(self.force))

    @property
    def impulse(self) -> float:
        """Momentum that the surface takes [N.s]."""
        return float(np.trapezoid(self.force, self.time))

    @property
    def measured_mass(self) -> float:
        """Mass that would bring this momentum: the impulse over the change of speed [kg]."""
        return self.impulse / (self.speed + self.left)


def assembled(*, rotors: bool) -> Assembly:
    """Assembles the task for a robot with or without its reflected inertia."""
    _, robot = read_task(TASK)
    patch = None if rotors else robot.folder / WITHOUT_ROTORS
    return assemble(TASK, effects=patch, rate=None, scale=1.0, arm=None)


def against(assembly: Assembly, stiffness: float) -> Assembly:
    """Replaces the surface's stiffness [N/m]."""
    surfaces = tuple(replace(surface, stiffness=stiffness) for surface in assembly.task.environment)
    return replace(assembly, task=replace(assembly.task, environment=surfaces))


def normal_mass(assembly: Assembly, q: Array, normal: Array) -> float:
    """Computes the apparent mass [kg] of the whole arm at its hand along a direction (3,)."""
    model = assembly.model
    hand = assembly.modules.arms[0].limb.hand
    kinematics = Kinematics(model, (hand,))
    kinematics.update(q, np.zeros(model.n))
    row = normal @ kinematics.jacobian_of(hand)[:3]
    return float(1.0 / (row @ np.linalg.solve(model.mass_matrix(q), row)))


def first_contact(assembly: Assembly, seed: int) -> Impact:
    """Runs the task without sensor noise and takes the first touch from the plant's truth.

    Raises:
        BadInput: The hand does not touch and leave again.
    """
    hand = assembly.modules.arms[0].limb.hand
    # An arm without rotors leaves the surface faster than a Baxter may move; the limit of speed would hold it there.
    kept = assembly.limits.snapshot() | {"velocity_max": 3.0 * assembly.limits.velocity_max}
    limits = FilterLimits(**kept)
    fast = replace(assembly.tank, speed_bound=3.0 * assembly.tank.speed_bound)
    assembly = replace(assembly, limits=limits, tank=fast)
    log: list[tuple[float, Array, Array, Array]] = []

    def observe(_state: RobotState, plant: Plant, _supervisor: Supervisor) -> None:
        force = plant.contact_wrench(hand)[:3].copy()
        log.append((plant.time, plant.pose(hand).translation.copy(), force, plant.position))

    watch_task(assembly, observe, seed=seed, noise=False)
    time = np.array([row[0] for row in log])
    place, force = np.array([row[1] for row in log]), np.array([row[2] for row in log])
    size = np.linalg.norm(force, axis=1)
    first = int(np.argmax(size > 0.0))
    last = first + int(np.argmax(size[first:] == 0.0))
    if last == first:
        raise BadInput(
            f"task '{TASK}': on a surface of {assembly.task.environment[0].stiffness:g} N/m the hand does not touch "
            "and leave again before the task ends (valid: a stiffer surface, or a longer phase)"
        )
    normal = force[first:last].sum(axis=0)
    normal /= np.linalg.norm(normal)
    speed = np.gradient(place @ normal, time)
    return Impact(
        stiffness=assembly.task.environment[0].stiffness,
        speed=float(-speed[first - 2]),
        left=float(speed[last + 1]),
        time=time[first - 1 : last + 1] - time[first - 1],
        force=size[first - 1 : last + 1],
        mass=normal_mass(assembly, log[first][3], normal),
    )


@dataclass(frozen=True)
class Masses:
    """Apparent masses at one posture.

    Attributes:
        angles: (3,) of the joints that move, from the shoulder outwards [rad].
        inverse: Name (with, without) -> (2, 2) inverse of the translational apparent inertia in the plane [1/kg].
    """

    angles: tuple[float, float, float]
    inverse: dict[str, Array]

    def extremes(self, robot: str) -> tuple[float, float]:
        """Largest and smallest apparent mass [kg]: the eigenvalues of Lambda."""
        values = np.linalg.eigvalsh(self.inverse[robot])
        return float(1.0 / values[0]), float(1.0 / values[1])


def planar_masses(
    model: RobotModel, limb: str, joints: Sequence[str], angles: tuple[float, float, float]
) -> Masses:
    r"""Computes the planar apparent inertia.

    \Lambda^-1 = J (M + I_r)^-1 J^T, J (2, 3) in the plane, once with I_r and once with zero (thesis 3.15).

    Args:
        model: The robot.
        limb: Name of the arm.
        joints: Short names of the three that may move, from the shoulder outwards; the others stand at zero,
            so that all motion stays in one upright plane.
        angles: Of these [rad].
    """
    arm = model.limbs[limb]
    moving = [arm.joints[arm.short_names.index(name)] for name in joints]
    q = np.zeros(model.n)
    q[moving] = angles
    kinematics = Kinematics(model, (arm.hand,))
    kinematics.update(q, np.zeros(model.n))
    jacobian = kinematics.jacobian_of(arm.hand)[:, moving]
    outwards = np.cross(jacobian[3:, 0], [0.0, 0.0, 1.0])
    plane = np.vstack([outwards / np.linalg.norm(outwards), [0.0, 0.0, 1.0]]) @ jacobian[:3]
    whole = model.mass_matrix(q)[np.ix_(moving, moving)]
    links = whole - np.diag(model.reflected_inertia[moving])
    inverse = {
        "with": plane @ np.linalg.solve(whole, plane.T),
        "without": plane @ np.linalg.solve(links, plane.T),
    }
    return Masses(angles, inverse)
