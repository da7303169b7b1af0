# SPDX-License-Identifier: BSD-3-Clause
"""What the rerun recording shows of a run: both arms, springs, wrenches, ellipsoids, tank, limits."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impedance_modules.episode.background import Background
from impedance_modules.episode.scene import Body, BodyShape, EllipsoidStyle, Pose7, Scene, ViewSample
from impedance_modules.episode.view import RecordingView
from impedance_modules.robot.pose import Pose
from impedance_modules.robot.rotation import exp3, log3
from impedance_modules.robot.shapes import LinkPoses, LinkShape, link_shapes
from impedance_modules.robot.state import RobotState
from impedance_modules.runtime.assembly import Assembly
from impedance_modules.runtime.compiled_row import quaternion
from impedance_modules.runtime.supervisor import Supervisor
from impedance_modules.safety.problem import RowKind
from impedance_modules.spec.task import ObjectSpec, SurfaceSpec
from impedance_modules.superposition.ellipsoid import ellipsoid
from impedance_modules.superposition.inertia import operational_inertia

Array = NDArray[np.float64]

INERTIA_SCALE = 0.02
"""Metres drawn per kg: a hand of 5 kg is a 10 cm half axis."""

STIFFNESS_SCALE = 0.0003
"""Metres drawn per N/m: 300 N/m is a 9 cm half axis."""

GROUND = 4.0
"""Edge length at which a plane is drawn [m]."""


class SceneView:
    """Feeds a run's samples to its recording."""

    def __init__(
        self, directory: Path, supervisor: Supervisor, background: Background, *, live: bool
    ) -> None:
        assembly = supervisor.assembly
        self._supervisor = supervisor
        self._assembly = assembly
        shapes = link_shapes(assembly.model)
        self._links = tuple(dict.fromkeys(shape.link for shape in shapes))
        self._poses = LinkPoses(assembly.model, self._links)
        self._springs = [spring for arm in assembly.modules.arms for spring in arm.springs]
        self._said = 0
        self._limb_joints = np.concatenate([arm.limb.joints for arm in assembly.modules.arms])
        self._kinds = tuple(kind.label for kind in RowKind)
        self.scene = _scene(assembly, shapes, self._links, self._kinds)
        name = assembly.task.name
        self._view = RecordingView(directory, self.scene, background, name=name, live=live)

    def add(self, state: RobotState, effort: Array) -> None:
        """Queues a sample when one is due."""
        if self._view.due(state.time):
            self._view.add(self._sample(state, effort))

    def close(self) -> None:
        """Finishes the file, after the run's background thread has stopped."""
        self._view.close()

    def _sample(self, state: RobotState, effort: Array) -> ViewSample:
        controller = self._supervisor.controller
        kinematics, memory = controller.kinematics, controller.memory
        slots = memory.index("slots")
        ends = np.stack([kinematics.translation[slots], memory["target_translation"]], axis=1)
        poses = [_seven(pose) for pose in self._poses.at(state.position)]
        held = controller.modules.held
        if held is not None:
            poses.append(_seven(held.pose_from(tuple(kinematics.pose(hand) for hand in held.hands))))
        ellipsoid_poses, half_axes = self._ellipsoids()
        said = self._supervisor.messages[self._said :]
        self._said = len(self._supervisor.messages)
        limits = self._assembly.limits.effort_max
        return ViewSample(
            time=state.time,
            poses=np.array(poses),
            springs=ends,
            wrench_points=kinematics.translation[: len(self._assembly.modules.arms)].copy(),
            wrenches=self._supervisor.touch.wrench.copy(),
            ellipsoid_poses=ellipsoid_poses,
            half_axes=half_axes,
            torque_ratio=(effort / limits)[self._limb_joints],
            tracking_error=self._tracking(),
            active_rows=self._active_rows(),
            tank=controller.level,
            phase=self._supervisor.sequence.phase.name,
            messages=tuple(text for _, text in said),
        )

    def _tracking(self) -> Array:
        controller = self._supervisor.controller
        memory, kinematics = controller.memory, controller.kinematics
        found = np.zeros((len(self._springs), 2))
        for row, slot in enumerate(memory.index("slots")):
            found[row, 0] = np.linalg.norm(kinematics.translation[slot] - memory["target_translation"][row])
            turn = kinematics.rotation[slot] @ memory["target_rotation"][row].T
            found[row, 1] = np.linalg.norm(log3(turn))
        return found

    def _active_rows(self) -> Array:
        solution = self._supervisor.controller.solution
        counts = np.zeros(len(self._kinds))
        if solution is None or solution.active is None or solution.box_duals is None:
            return counts
        kinds = self._supervisor.controller.workspace.layout.kinds
        for row in np.flatnonzero(solution.active):
            counts[self._kinds.index(kinds[row].label)] += 1
        return counts

    def _ellipsoids(self) -> tuple[Array, Array]:
        """Inertia and stiffness of every hand, at the hand."""
        controller = self._supervisor.controller
        kinematics, memory = controller.kinematics, controller.memory
        stiffness = memory["stiffness"][2]
        slots = memory.index("slots")
        poses, axes = [], []
        for row, arm in enumerate(self._assembly.modules.arms):
            joints = arm.limb.joints
            inertia = operational_inertia(
                kinematics.jacobian[row][:, joints], kinematics.inverse_inertia[np.ix_(joints, joints)]
            ).inertia
            springs = stiffness[slots == row].sum(axis=0)[:3, :3]
            blocks = (None if inertia is None else inertia[:3, :3], springs * controller.spring_scale)
            for block in blocks:
                pose, half = _drawn(block, kinematics.translation[row])
                poses.append(pose)
                axes.append(half)
        return np.array(poses), np.array(axes)


def _drawn(block: Array | None, centre: Array) -> tuple[Pose7, Array]:
    if block is None:
        return _seven(Pose(np.eye(3), centre)), np.full(3, np.nan)
    found = ellipsoid(block)
    return _seven(Pose(found.directions, centre)), found.half_axes


def _seven(pose: Pose) -> Pose7:
    out = np.zeros(4)
    quaternion(np.ascontiguousarray(pose.rotation), out)
    x, y, z = pose.translation
    return (float(x), float(y), float(z), float(out[0]), float(out[1]), float(out[2]), float(out[3]))


def _scene(
    assembly: Assembly, shapes: tuple[LinkShape, ...], links: tuple[str, ...], kinds: tuple[str, ...]
) -> Scene:
    bodies = [
        Body(link, tuple(_body_shape(i, s) for i, s in enumerate(shapes) if s.link == link), "robot")
        for link in links
    ]
    held = assembly.task.object
    if held is not None:
        bodies.append(Body("object", (_object_shape(held),), "object"))
    arms = assembly.modules.arms
    ellipsoids = [
        EllipsoidStyle(f"{arm.limb.name}/{name}", scale)
        for arm in arms
        for name, scale in (("inertia", INERTIA_SCALE), ("stiffness", STIFFNESS_SCALE))
    ]
    names = tuple(spring.name for arm in arms for spring in arm.springs)
    return Scene(
        bodies=tuple(bodies),
        surfaces=tuple(_surface(i, s) for i, s in enumerate(assembly.task.environment)),
        springs=names,
        wrenches=tuple(f"on {arm.limb.hand}" for arm in arms),
        ellipsoids=tuple(ellipsoids),
        limbs={arm.limb.name: arm.limb.joint_names for arm in arms},
        tracked=names,
        constraints=kinds,
        tank_floor=assembly.tank.floor,
        tank_max=assembly.tank.max,
    )


def _body_shape(index: int, shape: LinkShape) -> BodyShape:
    return BodyShape(f"{shape.kind}{index}", shape.kind, shape.size, _seven(shape.pose))  # type: ignore[arg-type]


def _object_shape(held: ObjectSpec) -> BodyShape:
    if held.shape == "box":
        return BodyShape("object", "box", held.size)
    if held.shape == "cylinder":
        return BodyShape("object", "cylinder", (0.5 * held.size[0], held.size[1]))
    return BodyShape("object", "sphere", (0.5 * held.size[0],))


def _surface(index: int, surface: SurfaceSpec) -> Body:
    rotation = exp3(np.array(surface.rotation))
    if surface.position is not None and surface.size is not None:
        centre, size = np.array(surface.position), surface.size
    else:
        thickness = 0.02
        top = np.array([0.0, 0.0, surface.height or 0.0])
        centre, size = top - rotation[:, 2] * 0.5 * thickness, (GROUND, GROUND, thickness)
    shape = BodyShape(surface.surface, "box", size, _seven(Pose(rotation, centre)))
    return Body(f"{surface.surface} {index}", (shape,), "surface")
