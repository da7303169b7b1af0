# SPDX-License-Identifier: BSD-3-Clause
r"""One guarded move on the plant, and the laws of the blow with which it begins (thesis 1.3).

A mass m that arrives with v at an elastic surface of stiffness k stops when its kinetic energy is in the surface,

    1/2 m v^2 = 1/2 k d^2,        F_peak = k d = v \sqrt{k m},        a quarter of a swing later, (\pi / 2) \sqrt{m / k}

with m the arm's apparent mass along the surface's normal, 1 / (n^T \Lambda^-1 n). With elastic joints the links strike
first, and their rotors follow behind the springs; links' inertia M, J the row of the normal, from q = \theta = 0,

    M q'' = K (\theta - q) + B (\theta' - q') - J^T k J q
    I_r \theta'' = -K (\theta - q) - B (\theta' - q') - D \theta'
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from impedance_experiments.apparent_mass import against, normal_mass
from impedance_experiments.task_run import task_with, watch_task
from impedance_experiments.thesis_page import Settings
from impedance_modules.arrays import Array
from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.control.supervisor import Supervisor
from impedance_modules.errors import BadInput
from impedance_modules.plant.plant import Plant
from impedance_modules.prediction.feasibility import refuse_infeasible
from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.state import RobotState
from impedance_modules.superposition.elastic_joints import drives_of

UP = np.array([0.0, 0.0, 1.0])
"""The surface's normal."""
TASK, APPROACH, STAY = "guarded-move", "approach", "stay"
LONGEST_BLOW, INSTANTS = 0.25, 2501
"""Time over which a blow is computed [s], and at how many instants."""


@dataclass(frozen=True)
class Touch:
    """The first touch of a guarded move, from the plant's truth.

    Attributes:
        stiffness: Of the surface [N/m].
        speed: Of the hand towards the surface when it arrives [m/s].
        time: (m,) since the touch, until the end of the run [s].
        force: (m,) normal force [N].
        noticed: When the guard ended the approach, since the touch [s].
        mass: Apparent mass along the normal, links and rotors [kg].
        links: The same of the links alone [kg].
        predicted: Peak of the arm on its elastic joints with the same velocities, controller left out [N].
    """

    stiffness: float
    speed: float
    time: Array
    force: Array
    noticed: float
    mass: float
    links: float
    predicted: float

    @property
    def blow(self) -> slice:
        """The samples until the hand leaves the surface for the first time, or all."""
        off = np.flatnonzero(self.force[1:] == 0.0)
        return slice(0, int(off[0]) + 2 if off.size else len(self.force))

    @property
    def peak(self) -> float:
        """Largest force of the blow [N]."""
        return float(np.max(self.force[self.blow]))

    @property
    def peak_time(self) -> float:
        """When it is reached, since the touch [s]."""
        return float(self.time[int(np.argmax(self.force[self.blow]))])

    @property
    def struck_mass(self) -> float:
        """Mass with which v sqrt(k m) is the measured peak [kg]."""
        return (self.peak / self.speed) ** 2 / self.stiffness

    @property
    def quarter_swing(self) -> float:
        """Time (pi / 2) sqrt(m / k) of that mass [s]."""
        return 0.5 * math.pi * math.sqrt(self.struck_mass / self.stiffness)

    @property
    def rotors_share(self) -> float:
        """Part of the mass of the rotors that is in the blow: 0 links alone, 1 all."""
        return (self.struck_mass - self.links) / (self.mass - self.links)

    @property
    def off(self) -> float:
        """Time off the surface after the touch [s]."""
        return float(np.mean(self.force == 0.0) * self.time[-1])


def guarded_move(duration: float, stiffness: float, settings: Settings) -> Touch:
    """Runs the task without sensor noise and takes the first touch.

    Args:
        duration: Of the approach [s].
        stiffness: Of the surface [N/m].
        settings: Seed and folder.

    Raises:
        BadInput: The task is refused, or the guard notices nothing.
    """
    assembly = against(approaching(duration, settings), stiffness)
    refuse_infeasible(assembly)
    hand = assembly.modules.arms[0].limb.hand
    log: list[tuple[float, float, float, str]] = []
    states: list[tuple[Array, Array]] = []

    def observe(_state: RobotState, plant: Plant, supervisor: Supervisor) -> None:
        height, force = float(plant.pose(hand).translation[2]), float(plant.contact_wrench(hand)[2])
        log.append((plant.time, height, force, supervisor.sequence.phase.name))
        states.append((plant.position, plant.velocity))

    watch_task(assembly, observe, seed=settings.seed, noise=False)
    time, height, force = (np.array([row[column] for row in log]) for column in range(3))
    stays = [row[0] for row in log if row[3] == STAY]
    if not stays or not np.any(force):
        raise BadInput(
            f"task '{TASK}': on a surface of {stiffness:g} N/m the hand notices nothing within {duration:g} s "
            "(valid: a surface in its way, a longer approach)"
        )
    first = int(np.argmax(force > 0.0))
    whole, links = _masses(assembly, states[first][0])
    return Touch(
        stiffness=stiffness,
        speed=-float(np.gradient(height, time)[first - 2]),
        time=time[first - 1 :] - time[first - 1],
        force=force[first - 1 :],
        noticed=stays[0] - float(time[first - 1]),
        mass=whole,
        links=links,
        predicted=elastic_peak(assembly, *states[first - 1]),
    )


def approaching(duration: float, settings: Settings) -> Assembly:
    """Assembles the task with another duration of its approach [s]."""
    values = {f"phases.{APPROACH}.duration": duration}
    path = task_with(TASK, values, settings.work, f"{duration:g}-s")
    return assemble(str(path), effects=None, rate=None, scale=1.0, arm=None)


def _normal_row(assembly: Assembly, q: Array) -> Array:
    """Gives how fast the hand rises with the joints, (n,) [m/rad]."""
    hand = assembly.modules.arms[0].limb.hand
    kinematics = Kinematics(assembly.model, (hand,))
    kinematics.update(q, np.zeros(assembly.model.n))
    return np.asarray(UP @ kinematics.jacobian_of(hand)[:3])


def _masses(assembly: Assembly, q: Array) -> tuple[float, float]:
    """Gives the apparent mass upwards with rotors and of the links alone [kg]."""
    model, row = assembly.model, _normal_row(assembly, q)
    links = model.mass_matrix(q) - np.diag(model.reflected_inertia)
    return normal_mass(assembly, q, UP), float(1.0 / (row @ np.linalg.solve(links, row)))


def elastic_peak(assembly: Assembly, q: Array, velocity: Array) -> float:
    """Lets links and rotors arrive at the task's surface on their own; returns the peak force [N].

    Args:
        assembly: The task; its controller is left out.
        q: (n,) at the touch [rad].
        velocity: (n,) of links and of rotors there [rad/s].
    """
    joints, stiffness = assembly.modules.arms[0].limb.joints, assembly.task.environment[0].stiffness
    row, k = _normal_row(assembly, q)[joints], len(joints)
    values, vectors = np.linalg.eig(_arm_on_surface(assembly, q, stiffness * np.outer(row, row)))
    start = np.concatenate([np.zeros(2 * k), velocity[joints], velocity[joints]])
    swings = np.exp(np.outer(np.linspace(0.0, LONGEST_BLOW, INSTANTS), values))
    moved = (swings * np.linalg.solve(vectors, start)) @ (row @ vectors[:k])
    force = -stiffness * moved.real
    left = np.flatnonzero(force[1:] < 0.0)
    return float(np.max(force[: left[0] + 1] if left.size else force))


def _arm_on_surface(assembly: Assembly, q: Array, pressed: Array) -> Array:
    """Writes x' = S x of x = (q, theta, q', theta') for an arm whose links a surface presses with ``pressed`` q."""
    model, joints = assembly.model, assembly.modules.arms[0].limb.joints
    drives, k = drives_of(model, joints), len(joints)
    columns = (drives.spring_stiffness, drives.spring_damping, drives.motor_damping)
    K, B, D = (np.diag(column) for column in columns)
    rotors, nothing = np.diag(drives.reflected_inertia), np.zeros((k, k))
    links = model.mass_matrix(q)[np.ix_(joints, joints)] - rotors
    stiffness = np.block([[K + pressed, -K], [-K, K]])
    damping = np.block([[B, -B], [-B, B + D]])
    inertia = np.block([[links, nothing], [nothing, rotors]])
    forces = np.linalg.solve(inertia, np.hstack([stiffness, damping]))
    return np.vstack([np.hstack([np.zeros((2 * k, 2 * k)), np.eye(2 * k)]), -forces])
