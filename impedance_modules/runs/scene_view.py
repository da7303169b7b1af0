# SPDX-License-Identifier: BSD-3-Clause
"""What the rerun recording shows of a run: both arms, springs, wrenches, ellipsoids, tank, limits."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.control.assembly import Assembly
from impedance_modules.control.supervisor import Supervisor
from impedance_modules.episode.background import Background
from impedance_modules.episode.live_view import RecordingView
from impedance_modules.episode.view_scene import (
    BodyShape,
    DrawnTriangles,
    EllipsoidStyle,
    Pose7,
    Scene,
    SceneBody,
    ViewSample,
)
from impedance_modules.modules.hinge import Hinge
from impedance_modules.modules.mobility import mobility
from impedance_modules.plant.sheet import Sheet
from impedance_modules.robot.pose import Pose
from impedance_modules.robot.rotation import exp3, rotation_angle
from impedance_modules.robot.shapes import LinkPoses, LinkShape, link_shapes
from impedance_modules.robot.state import RobotState
from impedance_modules.runs.recorder import write_poses
from impedance_modules.safety.filter_problem import RowKind
from impedance_modules.spec.task import ObjectSpec, SurfaceSpec
from impedance_modules.superposition.operational_inertia import ellipsoid, from_mobility

INERTIA_SCALE = 0.02
"""Metres drawn per kg: a hand of 5 kg is a 10 cm half axis."""

STIFFNESS_SCALE = 0.0003
"""Metres drawn per N/m: 300 N/m is a 9 cm half axis."""

GROUND = 4.0
"""Edge length at which a plane is drawn [m]."""

AXIS_RADIUS, AXIS_LENGTH = 0.005, 0.2
"""With which a hinge's axis is drawn [m]."""

STRIPS, THIN = 40, 0.002
"""How many strips a sheet is drawn as, also each way a saddle, and how thick [m]."""


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
        self._arms = len(assembly.modules.arms)
        self._slots = supervisor.controller.cycle.modules.springs.frame
        self._said = 0
        self._limb_joints = np.concatenate([arm.limb.joints for arm in assembly.modules.arms])
        self._kinds = tuple(kind.label for kind in RowKind)
        self.scene = _scene(assembly, shapes, self._links, self._kinds)
        name = assembly.task.name
        self._view = RecordingView(directory, self.scene, background, name=name, live=live)

    @property
    def failure(self) -> Exception | None:
        """Why the recording could not be written, or None."""
        return self._view.failure

    def add(self, state: RobotState, effort: Array) -> None:
        """Queues a sample when one is due."""
        if self._view.due(state.time):
            self._view.add(self._sample(state, effort))

    def close(self) -> None:
        """Finishes the file, after the run's background thread has stopped."""
        self._view.close()

    def _sample(self, state: RobotState, effort: Array) -> ViewSample:
        controller = self._supervisor.controller
        kinematics, springs = controller.kinematics, controller.cycle.modules.springs
        ends = np.stack([kinematics.translation[self._slots], springs.target_translation], axis=1)
        ellipsoid_poses, half_axes = self._ellipsoids()
        said = self._supervisor.messages[self._said :]
        self._said = len(self._supervisor.messages)
        limits = self._assembly.limits.effort_max
        return ViewSample(
            time=state.time,
            poses=self._body_poses(state.position),
            springs=ends,
            wrench_points=kinematics.translation[: self._arms].copy(),
            wrenches=self._supervisor.hand_wrenches.wrench.copy(),
            ellipsoid_poses=ellipsoid_poses,
            half_axes=half_axes,
            torque_ratio=(effort / limits)[self._limb_joints],
            tracking_error=self._tracking(),
            active_rows=self._active_rows(),
            tank=controller.tank.level,
            phase=self._supervisor.sequence.phase.name,
            messages=tuple(text for _, text in said),
        )

    def _body_poses(self, q: Array) -> Array:
        """Places every link, and the held object where its hands say it is, (bodies, 7)."""
        controller = self._supervisor.controller
        held = controller.modules.held
        poses = np.zeros((len(self.scene.bodies), 7))
        self._poses.update(q)
        write_poses(self._poses.rotation, self._poses.translation, poses[: len(self._links)])
        if held is not None:
            hands = tuple(controller.kinematics.pose(hand) for hand in held.hands)
            poses[-1] = _seven(held.pose_from(hands))
        return poses

    def _tracking(self) -> Array:
        """Gives distance [m] and angle [rad] of every spring's frame to its target, (springs, 2)."""
        controller = self._supervisor.controller
        springs, kinematics = controller.cycle.modules.springs, controller.kinematics
        away = kinematics.translation[self._slots] - springs.target_translation
        turn = kinematics.rotation[self._slots] @ springs.target_rotation.transpose(0, 2, 1)
        distances = np.linalg.norm(away, axis=1)
        return np.column_stack([distances, rotation_angle(turn)])

    def _active_rows(self) -> Array:
        controller = self._supervisor.controller
        counts = np.zeros(len(self._kinds))
        solution = controller.solution if controller.changed else None
        if solution is None or solution.active is None:
            return counts
        kinds = controller.layout.kinds
        for row in np.flatnonzero(solution.active):
            counts[self._kinds.index(kinds[row].label)] += 1
        return counts

    def _ellipsoids(self) -> tuple[Array, Array]:
        """Inertia and stiffness of every hand in turn, at the hand: (2 arms, 7) and half axes (2 arms, 3)."""
        controller, arms = self._supervisor.controller, self._arms
        kinematics = controller.kinematics
        blocks, missing = np.zeros((2 * arms, 3, 3)), []
        for row in range(arms):
            inertia = from_mobility(mobility(kinematics.jacobian[row], kinematics.inverse_inertia)).inertia
            if inertia is None:
                missing.append(2 * row)
            else:
                blocks[2 * row] = inertia[:3, :3]
            springs = controller.cycle.modules.springs.stiffness[self._slots == row].sum(axis=0)
            blocks[2 * row + 1] = springs[:3, :3] * controller.tank.spring_scale
        found = ellipsoid(blocks)
        poses = np.zeros((2 * arms, 7))
        write_poses(found.directions, np.repeat(kinematics.translation[:arms], 2, axis=0), poses)
        # Where no inertia exists there is nothing to draw.
        half_axes = found.half_axes
        half_axes[missing] = np.nan
        return poses, half_axes


def _seven(pose: Pose) -> Pose7:
    out = np.zeros((1, 7))
    write_poses(np.ascontiguousarray(pose.rotation)[None], pose.translation[None], out)
    x, y, z, qx, qy, qz, qw = out[0].tolist()
    return (x, y, z, qx, qy, qz, qw)


def _scene(
    assembly: Assembly, shapes: tuple[LinkShape, ...], links: tuple[str, ...], kinds: tuple[str, ...]
) -> Scene:
    bodies = [
        SceneBody(link, tuple(_body_shape(i, s) for i, s in enumerate(shapes) if s.link == link), "robot")
        for link in links
    ]
    held = assembly.task.object
    if held is not None:
        bodies.append(SceneBody("object", (_object_shape(held),), "object"))
    arms, hinge = (
        assembly.modules.arms,
        None if assembly.modules.held is None else assembly.modules.held.hinge,
    )
    still = tuple(_surface(i, s) for i, s in enumerate(assembly.task.environment))
    ellipsoids = [
        EllipsoidStyle(f"{arm.limb.name}/{name}", scale)
        for arm in arms
        for name, scale in (("inertia", INERTIA_SCALE), ("stiffness", STIFFNESS_SCALE))
    ]
    names = tuple(spring.name for arm in arms for spring in arm.springs)
    return Scene(
        bodies=tuple(bodies),
        surfaces=still if hinge is None else (*still, _axis(hinge)),
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


def _axis(hinge: Hinge) -> SceneBody:
    """Draws the axis about which the object turns."""
    shape = BodyShape("hinge", "cylinder", (AXIS_RADIUS, AXIS_LENGTH), _seven(hinge.frame))
    return SceneBody("hinge", (shape,), "surface")


def _surface(index: int, surface: SurfaceSpec) -> SceneBody:
    rotation = exp3(np.array(surface.rotation))
    name = f"{surface.surface} {index}"
    if surface.sheet is not None:
        return SceneBody(name, _strips(surface, Sheet(surface.sheet), rotation), "surface")
    if surface.position is None:
        thickness = 0.02
        top = np.array([0.0, 0.0, surface.height or 0.0])
        pose = Pose(rotation, top - rotation[:, 2] * 0.5 * thickness)
        shape = BodyShape(surface.surface, "box", (GROUND, GROUND, thickness), _seven(pose))
    else:
        shape = _body_of_surface(surface, _seven(Pose(rotation, np.array(surface.position))))
    return SceneBody(name, (shape,), "surface")


def _body_of_surface(surface: SurfaceSpec, pose: Pose7) -> BodyShape:
    """Draws a box, a cylinder, a sphere, a mesh or a saddle where it stands."""
    size, name = surface.size or (), surface.surface
    if surface.mesh is not None:
        drawn = DrawnTriangles(surface.mesh.vertices, surface.mesh.triangles)
        return BodyShape(name, "triangles", (), pose, drawn)
    if surface.radii is not None:
        return BodyShape(name, "triangles", (), pose, _saddle(size, surface.radii))
    if name == "cylinder":
        return BodyShape(name, "cylinder", (0.5 * size[0], size[1]), pose)
    if name == "sphere":
        return BodyShape(name, "sphere", (0.5 * size[0],), pose)
    return BodyShape(name, "box", size, pose)


def _saddle(size: tuple[float, ...], radii: tuple[float, float]) -> DrawnTriangles:
    """Draws a saddle at rest as a grid of triangles over its rectangle."""
    x, y = (np.linspace(-0.5 * edge, 0.5 * edge, STRIPS + 1) for edge in size)
    x, y = np.meshgrid(x, y, indexing="ij")
    z = x**2 / (2.0 * radii[0]) - y**2 / (2.0 * radii[1])
    number = np.arange(x.size).reshape(x.shape)
    first, second, third, fourth = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    triangles = [np.stack(corners, axis=-1) for corners in ((first, second, third), (first, third, fourth))]
    return DrawnTriangles(
        np.stack([x, y, z], axis=-1).reshape(-1, 3), np.concatenate(triangles).reshape(-1, 3)
    )


def _strips(surface: SurfaceSpec, sheet: Sheet, rotation: Array) -> tuple[BodyShape, ...]:
    """Draws a sheet at rest as narrow strips, each along its chord."""
    first, last = float(sheet.spans[0, 0]), float(sheet.spans[-1, :2].sum())
    ends = np.linspace(first, last, STRIPS + 1)
    points = [sheet.point(float(np.clip(x, first, last))) for x in ends]
    heights = np.array([0.0 if point is None else point.height for point in points])
    shapes = []
    for i in range(STRIPS):
        run, rise = ends[i + 1] - ends[i], heights[i + 1] - heights[i]
        middle = np.array([0.5 * (ends[i] + ends[i + 1]), 0.0, 0.5 * (heights[i] + heights[i + 1])])
        turn = rotation @ exp3(np.array([0.0, -np.arctan2(rise, run), 0.0]))
        pose = Pose(turn, np.array(surface.position) + rotation @ middle)
        size = (float(np.hypot(run, rise)), 2.0 * sheet.half_width, THIN)
        shapes.append(BodyShape(f"strip{i}", "box", size, _seven(pose)))
    return tuple(shapes)
