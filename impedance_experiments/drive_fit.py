# SPDX-License-Identifier: BSD-3-Clause
"""One joint's drive fitted with the diagnosis' residuals and the catalogue's laws (thesis 3.2, 6.2.1)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from impedance_experiments.task_run import TaskRun
from impedance_modules.diagnosis.data.admission import admit
from impedance_modules.diagnosis.residuals.band import choose_cutoff
from impedance_modules.diagnosis.data.nominal_model import model_of_spec
from impedance_modules.diagnosis.residuals.preparation import Prepared, prepare
from impedance_modules.diagnosis.rigid import BatchedRigidModel
from impedance_modules.effects.catalogue import BENCH, CATALOGUE
from impedance_modules.spec.patch_file import EffectSpec
from impedance_modules.spec.robot_spec import RobotSpec

Array = NDArray[np.float64]


@dataclass(frozen=True)
class DriveFit:
    """What laws of the catalogue say about one joint's drive.

    Attributes:
        values: Law -> symbol -> number.
        accounted: Share of the torque's variance that the laws account for.
        time: (M,) of the kept samples, one recording after the other [s].
        speed: (M,) of the motor [rad/s].
        load: (M,) torque that the joint's sensor reads [N.m].
        rotor: (M,) torque of the fitted rotor inertia [N.m]; zero where it is not among the laws.
        torque, fitted: (M,) what the drive takes for itself, measured and by the laws [N.m].
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
    """Returns the robot as somebody believes it who knows neither I_r nor motor damping of a joint."""
    bare = replace(robot.joints[joint], reflected_inertia=0.0, motor_damping=0.0)
    return replace(robot, joints={**robot.joints, joint: bare})


def bench_of(run: TaskRun) -> tuple[EffectSpec, ...]:
    """Lists what the run's patch fixed to the arm: clamps and springs, which whoever built the bench knows."""
    patch = run.assembly.patch
    return () if patch is None else tuple(spec for spec in patch.effects if spec.effect in BENCH)


def fit_drive(runs: Sequence[TaskRun], joint: str, laws: Sequence[str]) -> DriveFit:
    r"""Fits u - e = I_r \ddot\theta + D \dot\theta + friction (thesis eq. 3.2) by least squares.

    The diagnosis admits and filters each recording and gives the residual between torque asked for and joint sensor
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
            law: CATALOGUE[law].values(own, {}, signals, joint, "actuator") for law, own in shares.items()
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
        logs[0], model, BatchedRigidModel.of_tree(robot.urdf, model.tree), choose_cutoff(logs), bench_of(run)
    )


def _columns(log: Prepared, joint: str, law: str) -> Array:
    found = CATALOGUE[law].regressor(log.signals, joint, "actuator", "actuator", {})
    if found is None:
        raise ValueError(f"'{law}' does not show between command and joint sensor")
    return log.band.condense(found.columns[:, 0])


def _kept(log: Prepared, values: Array, index: int) -> Array:
    return log.band.condense(values[:, [index]])[:, 0]
