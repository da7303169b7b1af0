# SPDX-License-Identifier: BSD-3-Clause
"""What a run records: every state and torque, everything the controller decided, sample by sample."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.backends.protocol import RealRobot
from impedance_modules.compiled import compiled
from impedance_modules.control.assembly import Assembly
from impedance_modules.control.cycle import Cycle
from impedance_modules.control.equilibrium_following import Following
from impedance_modules.control.gripper_watch import gripper_columns
from impedance_modules.control.hinge_reading import hinge_reading, read_hinge
from impedance_modules.control.recorded_paths import paths_as_metadata
from impedance_modules.control.supervisor import Supervisor
from impedance_modules.episode.columns import (
    HINGE_COLUMNS,
    joint_columns,
    pose_columns,
    set_point_columns,
    target_columns,
    wrench_columns,
)
from impedance_modules.episode.metadata import episode_metadata, library_versions
from impedance_modules.episode.writer import EpisodeWriter
from impedance_modules.modules.compensation import COMPENSATION
from impedance_modules.modules.own_module import OWN
from impedance_modules.records import IndexMatrix, Indices, Matrix, Record, Vector
from impedance_modules.robot.rotation import write_quaternion
from impedance_modules.robot.state import RobotState

SCALARS = (
    "tank",
    "spring_scale",
    "granted",
    "paid",
    "phase_clock",
    "rung",
    "active_rows",
    "late",
    "interrupt",
)
"""Level [J]; part of the springs in force, of the motion granted, of the torque paid; [s]; stop level;
number of active filter rows; 1 where the last torque came too late or somebody asked for a stop. ``write_row`` knows
the order."""

SIMULATORS = {"mujoco": ("mujoco-core",)}
"""Backend -> package whose physics a recording comes from; the built-in plant's is this one."""

MISSED = "missed"
"""Column of a real robot's episode: control cycles without a state since the row before."""


class RecordedRow(Record):
    """One row of an episode, and what of a cycle is written into it.

    Attributes:
        values: (columns without the phase,).
        wrench: (hands, 6) of the surroundings on each hand.
        springs: Springs whose targets are recorded.
        modules: (k, 2) module and joint of every torque that is recorded.
    """

    values: Vector
    wrench: Matrix
    springs: Indices
    modules: IndexMatrix


@compiled
def write_row(
    row: RecordedRow, cycle: Cycle, q: Array, velocity: Array, effort: Array, command: Array
) -> None:
    """Writes what a cycle came to, in the order of ``columns``, but for the entries that ``Recorder`` knows.

    Args:
        row: ``values`` is overwritten.
        cycle: The last one; hands come first among its frames.
        q: (n,) measured [rad].
        velocity: (n,) measured [rad/s].
        effort: (n,) measured [N.m].
        command: (n,) torque that left [N.m].
    """
    values, n = row.values, q.size
    for j in range(n):
        values[1 + j] = q[j]
        values[1 + n + j] = velocity[j]
        values[1 + 2 * n + j] = command[j]
        values[1 + 3 * n + j] = effort[j]
    k = 1 + 4 * n
    values[k], values[k + 1] = cycle.tank.level, cycle.tank.spring_scale
    values[k + 2], values[k + 3], values[k + 4] = cycle.admitted, cycle.effort_scale, cycle.clock
    k += 9
    hands, springs = row.wrench.shape[0], cycle.modules.springs
    for h in range(hands):
        k = _write_pose(values, k, cycle.arms.rotation[h], cycle.arms.translation[h])
    for s in row.springs:
        k = _write_pose(values, k, springs.target_rotation[s], springs.target_translation[s])
    for h in range(hands):
        values[k : k + 6] = row.wrench[h]
        k += 6
    for m in range(row.modules.shape[0]):
        values[k + m] = cycle.modules.efforts[row.modules[m, 0], row.modules[m, 1]]


@compiled
def _write_pose(values: Array, at: int, rotation: Array, translation: Array) -> int:
    for k in range(3):
        values[at + k] = translation[k]
    write_quaternion(rotation, values[at + 3 : at + 7])
    return at + 7


@compiled
def write_poses(rotation: Array, translation: Array, out: Array) -> None:
    """Writes poses (k, 3, 3), (k, 3) [m] as (k, 7): position, then unit quaternion (x, y, z, w)."""
    for k in range(len(out)):
        _write_pose(out[k], 0, rotation[k], translation[k])


class Recorder:
    """Turns cycles into rows of an episode.

    Attributes:
        writer: Of the episode.
        columns: Names, the phase last.
        row: (columns without the phase,) of the last cycle; the next one overwrites it.
    """

    def __init__(
        self,
        directory: Path,
        supervisor: Supervisor,
        acting: Array,
        seed: int,
        backend: str,
        *,
        simulated: bool,
        real: RealRobot | None = None,
        mjcf: Path | None = None,
    ) -> None:
        """Opens the episode.

        Args:
            directory: Of the run.
            supervisor: Whose cycles are recorded.
            acting: (n,) torque that acts when the run begins [N.m].
            seed: Of the simulated noise.
            backend: Its name.
            simulated: True if the loop may wait for the disk.
            real: Tells what else is recorded of it; None for a simulated robot.
            mjcf: MuJoCo model that it was simulated with instead of its folder's.

        Raises:
            BadInput: The directory holds an episode already.
        """
        assembly = supervisor.assembly
        self._supervisor = supervisor
        self._targets = _recorded_targets(assembly)
        self._modules = _recorded_modules(supervisor)
        metadata = run_metadata(assembly, directory, acting, seed, backend)
        if mjcf is not None:
            metadata["mjcf"] = str(mjcf)
        names = columns(supervisor, self._targets, self._modules)
        self._real, self._own = real, len(names) - 1
        if real is not None:
            names[-1:-1] = (MISSED, *real.extra_columns())
        self.writer = EpisodeWriter(directory, names, metadata, wait_for_disk=simulated)
        self.columns = tuple(names)
        self.row: Array = np.zeros(len(names) - 1)
        self._own_row = RecordedRow(
            values=self.row[: self._own],
            wrench=supervisor.hand_wrenches.wrench,
            springs=np.array([spring for _, spring in self._targets], dtype=np.int64),
            modules=np.array([place for _, *place in self._modules], dtype=np.int64).reshape(-1, 2),
        )
        self._scalars_at = names.index("rung")
        self._set_points = self._set_points_of(names, _followed(assembly))
        self._grippers = self._part_of(names, gripper_columns(assembly.task))
        self._hinge = hinge_reading(assembly.modules.held, _hands(assembly))

    def _set_points_of(self, names: list[str], targets: tuple[str, ...]) -> Array | None:
        """The part of a row that tells what each target follows, (targets, columns); None without such targets."""
        if not targets:
            return None
        wide = set_point_columns(targets[0])
        first = names.index(wide[0])
        return self.row[first : first + len(targets) * len(wide)].reshape(len(targets), len(wide))

    def _part_of(self, names: list[str], wanted: tuple[str, ...]) -> Array | None:
        """The part of a row that some columns, which stand together, have; None for none."""
        if not wanted:
            return None
        first = names.index(wanted[0])
        return self.row[first : first + len(wanted)]

    def warm(self) -> None:
        """Fills a row once without recording it: a first call waits for its machine code, for longer than a period."""
        n = self._supervisor.assembly.model.n
        parts = np.zeros(n), np.zeros(n), np.zeros(n)
        # As a robot's states are: machine code for arrays that may be written is other machine code.
        for part in parts:
            part.flags.writeable = False
        self._fill(RobotState(0.0, *parts), np.zeros(n), late=False, interrupted=False)

    def add(self, state: RobotState, command: Array, *, late: bool, interrupted: bool) -> None:
        """Records one cycle: a state, and the torque in force after it (zero where none is)."""
        self._fill(state, command, late=late, interrupted=interrupted)
        if self._real is not None:
            self.row[self._own] = self._supervisor.missed
            self.row[self._own + 1 :] = self._real.extra_values()
        self.writer.append(self.row, self._supervisor.sequence.phase.name)

    def _fill(self, state: RobotState, command: Array, *, late: bool, interrupted: bool) -> None:
        supervisor, row, at = self._supervisor, self.row, self._scalars_at
        controller = supervisor.controller
        write_row(self._own_row, controller.cycle, state.position, state.velocity, state.effort, command)
        row[0] = state.time
        row[at], row[at + 1] = supervisor.stop_level, controller.active_rows
        row[at + 2], row[at + 3] = late, interrupted
        if self._set_points is not None:
            _write_set_points(self._set_points, supervisor.followed)
        if self._grippers is not None:
            supervisor.grippers.write(self._grippers)
        if self._hinge is not None:
            read_hinge(self._hinge, controller.cycle.arms, supervisor.hand_wrenches.wrench)
            row[self._own - 2], row[self._own - 1] = self._hinge.angle, self._hinge.torque

    def close(self, ending: str, reason: str) -> None:
        """Merges the episode and says in it how the run ended."""
        self.writer.close(ending=ending, reason=reason)

    def abandon(self) -> None:
        """Gives the directory back before a single row was recorded."""
        self.writer.abandon()


def columns(
    supervisor: Supervisor, targets: list[tuple[str, int]], modules: list[tuple[str, int, int]]
) -> list[str]:
    """Names the columns of a run, the phase last."""
    assembly = supervisor.assembly
    joints = assembly.model.joint_names
    hands = _hands(assembly)
    names = ["time"]
    for kind in ("position", "velocity", "effort_command", "effort"):
        names += joint_columns(kind, joints)
    names += SCALARS
    for hand in hands:
        names += pose_columns(hand)
    for frame, _ in targets:
        names += target_columns(frame)
    for hand in hands:
        names += wrench_columns(hand)
    names += [name for name, _, _ in modules]
    names += gripper_columns(assembly.task)
    for target in _followed(assembly):
        names += set_point_columns(target)
    if assembly.modules.held is not None and assembly.modules.held.hinge is not None:
        names += HINGE_COLUMNS
    return [*names, "phase"]


def _followed(assembly: Assembly) -> tuple[str, ...]:
    """Names the targets that follow set-points in some phase."""
    return () if assembly.task.set_points is None else tuple(assembly.task.set_points.targets)


def _write_set_points(table: Array, following: Following) -> None:
    """Writes what every target follows, one row each, in the order of ``set_point_columns``; NaN where nothing."""
    if not following.active:
        table[:, 0], table[:, 1:] = 0.0, np.nan
        return
    table[:, 0] = following.fresh
    table[:, 1:8] = following.goal
    table[:, 8:14], table[:, 14:20] = following.stiffness, following.force


def _hands(assembly: Assembly) -> tuple[str, ...]:
    return tuple(arm.limb.hand for arm in assembly.modules.arms)


def _recorded_targets(assembly: Assembly) -> list[tuple[str, int]]:
    """Lists (frame, spring's place) of the first spring on each frame."""
    springs = [spring for arm in assembly.modules.arms for spring in arm.springs]
    found: dict[str, int] = {}
    for slot, spring in enumerate(springs):
        found.setdefault(spring.frame, slot)
    return list(found.items())


def _recorded_modules(supervisor: Supervisor) -> list[tuple[str, int, int]]:
    """Lists (column, module, joint) of every torque that a module can put on a joint."""
    controller, assembly = supervisor.controller, supervisor.assembly
    found: list[tuple[str, int, int]] = []
    everywhere = np.concatenate([arm.limb.joints for arm in assembly.modules.arms])
    shared: dict[str, tuple[str, ...]] = {s.module: s.limbs for s in assembly.modules.between}
    shared |= {obstacle.module: obstacle.limbs for obstacle in assembly.modules.obstacles}
    for row, name in enumerate(controller.module_names):
        limbs = shared.get(name, (name.partition(".")[0],))
        owners = [arm.limb.joints for arm in assembly.modules.arms if arm.limb.name in limbs]
        joints = np.concatenate(owners) if owners else everywhere
        if not owners and not name.startswith((COMPENSATION, OWN)) and assembly.modules.held is None:
            continue
        for joint in joints:
            found.append((f"module.{name}.{assembly.model.joint_names[joint]}", row, int(joint)))
    return found


def run_metadata(
    assembly: Assembly, directory: Path, acting: Array, seed: int, backend: str
) -> dict[str, Any]:
    """Says what the episode is, and everything a replay needs to compute the same torques."""
    patch, compensation = assembly.patch, assembly.compensation
    limits = assembly.limits
    names = assembly.model.joint_names
    return episode_metadata(
        robot=assembly.robot.name,
        episode=directory.resolve().name,
        effort_source="joint_sensor",
        gravity_compensation=assembly.robot.gravity_compensation,
        repeat_of=None,
        task=assembly.task.text,
        task_path=str(assembly.task.path),
        task_name=assembly.task.name,
        arms=[arm.limb.name for arm in assembly.modules.arms],
        rate=assembly.rate,
        scale=assembly.scale,
        arm=assembly.arm,
        allow_unstable=assembly.allow_unstable,
        seed=seed,
        backend=backend,
        effects=None if patch is None else patch.text,
        **({} if compensation is None else {"compensate": compensation.patch.text}),
        **paths_as_metadata(assembly.task),
        **({"own_modules": [module.name for module in assembly.own]} if assembly.own else {}),
        joint_origins={
            name: [list(origin.translation), list(origin.roll_pitch_yaw)]
            for name, origin in assembly.robot.joint_origins.items()
        },
        acting=acting.tolist(),
        versions=library_versions(*SIMULATORS.get(backend, ())),
        effort_max=dict(zip(names, limits.effort_max.tolist(), strict=True)),
        tank={"floor": assembly.tank.floor, "max": assembly.tank.max, "initial": assembly.tank.initial},
        limbs={arm.limb.name: list(arm.limb.joint_names) for arm in assembly.modules.arms},
    )
