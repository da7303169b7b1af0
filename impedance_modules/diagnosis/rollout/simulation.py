# SPDX-License-Identifier: BSD-3-Clause
"""One simulation of a rollout with all that it needs, so that any process can compute it, on any machine."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from impedance_modules.diagnosis.data.rigid_tree import RigidTree
from impedance_modules.diagnosis.rollout.simulated_robot import FittedNuisance, apply_causes
from impedance_modules.diagnosis.rollout.simulated_windows import (
    DrivenRecording,
    RolloutWindow,
    WindowErrors,
    simulate_windows,
)
from impedance_modules.spec.patch_file import EffectSpec
from impedance_modules.spec.robot_spec import RobotSpec


@dataclass(frozen=True, eq=False)
class RolloutRobot:
    """What all simulations of a diagnosis have in common.

    Attributes:
        spec: The nominal robot.
        description: Contents of its URDF, for machines that do not have the file.
        tree: The recorded joints' bodies.
        drive: Recorded torque that drives the plant.
    """

    spec: RobotSpec
    description: bytes
    tree: RigidTree
    drive: str


@dataclass(frozen=True, eq=False)
class Simulation:
    """One simulation.

    Attributes:
        causes: Effects that the plant has.
        nuisance: Changes beside them.
        windows: Windows that are simulated.
    """

    causes: tuple[EffectSpec, ...]
    nuisance: FittedNuisance
    windows: tuple[RolloutWindow, ...]


def simulate(
    robot: RolloutRobot, recordings: Mapping[int, DrivenRecording], simulation: Simulation
) -> WindowErrors:
    """Simulates the windows of recordings.

    Args:
        robot: What is simulated.
        recordings: Index -> recording, those of all windows at least.
        simulation: Effects and windows.

    Raises:
        BadInput: The plant cannot have these effects, or its motion is not finite.
    """
    with _described(robot) as spec:
        perturbed = apply_causes(spec, simulation.causes, simulation.nuisance, robot.tree)
        return simulate_windows(perturbed, robot.drive, recordings, simulation.windows)


@contextmanager
def _described(robot: RolloutRobot) -> Iterator[RobotSpec]:
    """The robot with its URDF: the file itself where it is at hand, else a copy of it."""
    urdf = robot.spec.urdf
    if urdf.is_file() and urdf.read_bytes() == robot.description:
        yield robot.spec
        return
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / urdf.name
        copy.write_bytes(robot.description)
        yield replace(robot.spec, urdf=copy, folder=copy.parent)
