# SPDX-License-Identifier: BSD-3-Clause
r"""One joint's drive identified: friction and inertia by least squares, inertia by a free swing (thesis 3.2).

**Least squares** (3.2, 6.2.1): the diagnosis' residual between commanded torque and joint sensor is fitted by laws of
the effects' catalogue, u - e = I_r \ddot\theta + D \dot\theta + friction.

**Free swing** (3.2.1): a joint on a virtual torsion spring K is hit, and p is the pole of the swing that follows.
Links M and rotor move as one (second order, as the thesis reads it):

    I_r = K / |p|^2 - M

or the rotor turns behind the joint's own spring K_s, and the virtual spring is late by T (eq. 3.1 to 3.3):

    (I_r p^2 + D p) + K_s (1 - g) + K g e^{-pT} = 0,    g = K_s / (M p^2 + K_s)

whose real and imaginary parts give I_r and D.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from impedance_experiments.task_run import TaskRun, patch_of, record_task, task_with
from impedance_modules.arrays import Array
from impedance_modules.diagnosis.data.admission import admit
from impedance_modules.diagnosis.data.nominal_model import model_of_spec
from impedance_modules.diagnosis.data.rigid_dynamics import BatchedRigidModel
from impedance_modules.diagnosis.residuals.band import choose_band
from impedance_modules.diagnosis.residuals.preparation import Prepared, prepare
from impedance_modules.effects.catalogue import CATALOGUE
from impedance_modules.effects.regressor import Site
from impedance_modules.effects.rigid_model import RigidModel
from impedance_modules.effects.springs import BenchSpring
from impedance_modules.spec.patch_file import EffectSpec
from impedance_modules.spec.robot_spec import RobotSpec
from impedance_modules.spec.task_reader import read_task

SETTLED = 0.12
"""From the end of the blow until the joint's own spring has stopped oscillating [s]."""


@dataclass(frozen=True)
class DriveFit:
    """One joint's drive as fitted by laws of the catalogue.

    Attributes:
        values: Law -> symbol -> number.
        accounted: Share of the torque's variance that the laws account for.
        time: (M,) of the kept samples, one recording after the other [s].
        speed: (M,) of the motor [rad/s].
        load: (M,) torque that the joint's sensor reads [N.m].
        rotor: (M,) torque of the fitted rotor inertia [N.m]; zero where it is not among the laws.
        torque, fitted: (M,) the drive's own torque, measured and by the laws [N.m].
    """

    values: Mapping[str, Mapping[str, float]]
    accounted: float
    time: Array
    speed: Array
    load: Array
    rotor: Array
    torque: Array
    fitted: Array


def without_drive(robot: RobotSpec, joint: str) -> RobotSpec:
    """Returns the robot without I_r and motor damping of one joint."""
    bare = replace(robot.joints[joint], reflected_inertia=0.0, motor_damping=0.0)
    return replace(robot, joints={**robot.joints, joint: bare})


def fixture_of(run: TaskRun) -> tuple[EffectSpec, ...]:
    """Lists the clamps and springs that the run's patch fixes to the arm: the known test fixture."""
    patch = run.assembly.patch
    return (
        ()
        if patch is None
        else tuple(spec for spec in patch.effects if isinstance(CATALOGUE[spec.effect], BenchSpring))
    )


def fit_drive(runs: Sequence[TaskRun], joint: str, laws: Sequence[str]) -> DriveFit:
    r"""Fits u - e = I_r \ddot\theta + D \dot\theta + friction (thesis eq. 3.2) by least squares.

    The diagnosis checks and filters each recording and gives the residual between commanded torque and joint sensor
    of a model that knows nothing of this joint's drive; each law gives its columns.

    Args:
        runs: Of one robot.
        joint: The joint.
        laws: Effects of the catalogue that are linear in their numbers.
    """
    logs = [_prepared(run, joint) for run in runs]
    index = logs[0].signals.joint(joint)
    blocks = [np.concatenate([_columns(log, joint, law) for log in logs]) for law in laws]
    torque = np.concatenate([log.residuals["actuator"][:, index] for log in logs])
    columns = np.concatenate(blocks, axis=1)
    solution = np.linalg.lstsq(columns, torque, rcond=None)[0]
    fitted = columns @ solution
    edges = np.cumsum([block.shape[1] for block in blocks])[:-1]
    shares = dict(zip(laws, np.split(solution, edges), strict=True))
    rotor = np.zeros_like(torque)
    if "reflected_inertia" in shares:
        rotor = blocks[laws.index("reflected_inertia")] @ shares["reflected_inertia"]
    signals = logs[0].signals
    return DriveFit(
        values={
            law: CATALOGUE[law].values(own, {}, Site(signals, joint, "actuator"))
            for law, own in shares.items()
        },
        accounted=1.0 - float(np.var(torque - fitted) / np.var(torque)),
        time=np.concatenate([log.time for log in logs]),
        speed=np.concatenate([_kept(log, log.signals.motor_velocity, index) for log in logs]),
        load=np.concatenate([log.load[:, index] for log in logs]),
        rotor=rotor,
        torque=torque,
        fitted=fitted,
    )


def _prepared(run: TaskRun, joint: str) -> Prepared:
    robot = without_drive(run.assembly.robot, joint)
    limb = next(limb for limb in robot.limbs.values() if joint in limb.joints.values())
    model = model_of_spec(robot, list(limb.joints.values()))
    logs, _ = admit([run.episode], model)
    return prepare(
        logs[0],
        model,
        BatchedRigidModel.of_tree(robot.urdf, model.tree),
        choose_band(logs),
        fixture_of(run),
    )


def _columns(log: Prepared, joint: str, law: str) -> Array:
    found = CATALOGUE[law].regressor(Site(log.signals, joint, "actuator"), "actuator", {})
    if found is None:
        raise ValueError(f"'{law}' does not show between command and joint sensor")
    return log.band.condense(found.columns[:, 0])


def _kept(log: Prepared, values: Array, index: int) -> Array:
    return log.band.condense(values[:, [index]])[:, 0]


@dataclass(frozen=True)
class FreeSwing:
    """One blow and the swing after it.

    Attributes:
        joint: Its name.
        stiffness: Of the virtual spring [N.m/rad].
        links: Inertia M of the links that swing with the joint, from the URDF [kg.m^2].
        frequency: Of the swing [rad/s].
        decay: Of the swing [1/s].
        plain: I_r if links and rotor move as one [kg.m^2].
        inertia, damping: I_r [kg.m^2] and D [N.m.s/rad] with the joint's own spring and the delay known.
        accounted: Share of the angle's variance that the decaying swing accounts for.
        time, angle, fitted: (N,) since the blow [s], and from the rest [rad].
    """

    joint: str
    stiffness: float
    links: float
    frequency: float
    decay: float
    plain: float
    inertia: float
    damping: float
    accounted: float
    time: Array
    angle: Array
    fitted: Array


def strike(task: str, patch: str, stiffness: float, folder: Path, seed: int) -> tuple[TaskRun, FreeSwing]:
    """Runs a task whose only push is a blow, with another virtual spring, in the clamp of a patch."""
    short, limb = _struck(task)
    mark = f"{stiffness:g}"
    changed = task_with(task, {f"arms.{limb}.joint_bias.stiffness.{short}": stiffness}, folder, mark)
    run = record_task(str(changed), folder / f"{task}-{mark}", effects=patch_of(task, patch), seed=seed)
    return run, read_swing(run, run.assembly.robot.limbs[limb].joints[short], stiffness)


def swinging_joint(task: str) -> str:
    """Names the joint that a task leaves without a damper, as the URDF calls it."""
    short, limb = _struck(task)
    return read_task(task)[1].limbs[limb].joints[short]


def _struck(task: str) -> tuple[str, str]:
    """Returns the joint, and its limb, that a task leaves without a damper: the one that swings."""
    spec, robot = read_task(task)
    limb = next(iter(spec.arms))
    damped = spec.document.data["arms"][limb]["joint_bias"]["damping"]
    return next(short for short in robot.limbs[limb].joints if short not in damped), limb


def read_swing(run: TaskRun, joint: str, stiffness: float) -> FreeSwing:
    """Fits a decaying sine to the joint's measured angle after the blow, and reads I_r from its pole."""
    push = run.assembly.task.pushes[0]
    first = push.start + push.rise + push.hold + push.fall + SETTLED
    episode, links = run.episode, links_inertia(run, joint)
    drive, timing = run.assembly.robot.joints[joint], run.assembly.robot.timing
    after = episode.time > first
    time, angle = episode.time[after] - first, episode.position[joint][after]
    pole, fitted = _pole(time, angle, np.sqrt(stiffness / (links + links)))
    late = timing.command_delay + 0.5 / run.assembly.rate
    inertia, damping = _rotor(pole, stiffness, links, drive.spring_stiffness, late)
    return FreeSwing(
        joint=joint,
        stiffness=stiffness,
        links=links,
        frequency=float(pole.imag),
        decay=float(-pole.real),
        plain=stiffness / abs(pole) ** 2 - links,
        inertia=inertia,
        damping=damping,
        accounted=1.0 - float(np.var(angle - fitted) / np.var(angle)),
        time=time + first - push.start,
        angle=angle,
        fitted=fitted,
    )


def links_inertia(run: TaskRun, joint: str) -> float:
    """Computes M of the links about a joint at the start, the joints beyond it held [kg.m^2]."""
    model = run.assembly.model
    posture = np.array([run.episode.position[name][0] for name in model.joint_names])
    diagonal = RigidModel.of_robot(model).inertia_diagonal(posture[None, :])
    return float(diagonal[0, model.joint_names.index(joint)])


def _pole(time: Array, angle: Array, about: float) -> tuple[complex, Array]:
    def swing(pole: Array) -> Array:
        decay, frequency = pole
        die = np.exp(-decay * time)
        shapes = np.stack(
            [die * np.cos(frequency * time), die * np.sin(frequency * time), np.ones_like(time)], -1
        )
        return np.asarray(shapes @ np.linalg.lstsq(shapes, angle, rcond=None)[0])

    tries = [
        least_squares(lambda pole: swing(pole) - angle, [1.0, about * factor])
        for factor in (0.6, 0.8, 1.0, 1.3)
    ]
    best = min(tries, key=lambda found: float(found.cost))
    return complex(-best.x[0], abs(best.x[1])), swing(best.x)


def _rotor(
    pole: complex, stiffness: float, links: float, spring: float | None, late: float
) -> tuple[float, float]:
    """Solves the motor's equation of motion at the pole for I_r and D."""
    follows = 1.0 if spring is None else spring / (links * pole**2 + spring)
    own = links * pole**2 * follows  # what the links take through the joint's spring
    rest = -(own + stiffness * follows * np.exp(-pole * late))
    square = pole**2
    matrix = np.array([[square.real, pole.real], [square.imag, pole.imag]])
    inertia, damping = np.linalg.solve(matrix, [rest.real, rest.imag])
    return float(inertia), float(damping)
