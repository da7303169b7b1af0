# SPDX-License-Identifier: BSD-3-Clause
"""What a task file says, as frozen data: springs, joint bias, hybrid axes, object, phases.

Notation: six-vectors and 6x6 matrices are ordered linear then angular, (x, y, z, rx, ry, rz).
SI units throughout: m, rad, N, N.m, N/m, N.m/rad, kg, s, J. Nothing here computes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from impedance_modules.spec.gripper_spec import GripperCondition, GripperOrder
from impedance_modules.spec.hinge_spec import HingeSpec
from impedance_modules.spec.path_spec import PathSpec
from impedance_modules.spec.set_point_limits import SetPointLimits
from impedance_modules.spec.submovement_spec import Submovement

if TYPE_CHECKING:
    from impedance_modules.spec.between_spec import BetweenSpec
    from impedance_modules.spec.document import Document
    from impedance_modules.spec.obstacle_spec import ObstacleSpec

Matrix = NDArray[np.float64]
WORLD, EQUILIBRIUM = "world", "equilibrium"
"""What a damper counts from."""

AXES: tuple[str, ...] = ("x", "y", "z", "rx", "ry", "rz")


@dataclass(frozen=True)
class HybridAxis:
    """A constant force along one axis of a spring, added to K (x0 - x) (eq. 4.35).

    Attributes:
        force: What the hand exerts along the axis [N] or [N.m].
        speed_limit: Adds damping |force| / speed_limit on the axis [m/s] or [rad/s]; None adds none.
    """

    force: float
    speed_limit: float | None


@dataclass(frozen=True)
class SpringSpec:
    """A virtual spring between a frame of an arm and its moving equilibrium.

    Attributes:
        name: Unique within the arm; targets refer to it as ``<arm>.<name>``.
        frame: Frame of the robot to which the spring is attached.
        expressed_in: ``world`` or a frame; its axes, frozen at the start posture, are the spring's axes.
        stiffness: (6, 6) symmetric positive semidefinite, in those axes.
        damping: (6, 6) explicit damping [N.s/m, N.m.s/rad]; simply adds. None adds none.
        damping_ratio: Damping from the inertia, zeta; None adds none.
        axes: Hybrid axes by axis name.
        damping_against: ``world``, or ``equilibrium``: the dampers brake only what differs from the equilibrium's way.
    """

    name: str
    frame: str
    expressed_in: str
    stiffness: Matrix
    damping: Matrix | None
    damping_ratio: float | None
    axes: Mapping[str, HybridAxis]
    damping_against: str = WORLD


@dataclass(frozen=True)
class JointBiasSpec:
    """Joint stiffness that pulls an arm to its posture, unprojected (thesis eq. 4.25).

    Attributes:
        stiffness: [N.m/rad] by the limb's short joint name.
        damping: [N.m.s/rad] by short joint name, explicit; None adds none.
        damping_ratio: Damping from (K_j, M + I_r); None adds none.
        damping_against: ``world``, or ``equilibrium``: the dampers count from the rate of the rest angles.
    """

    stiffness: Mapping[str, float]
    damping: Mapping[str, float] | None
    damping_ratio: float | None
    damping_against: str = WORLD


@dataclass(frozen=True)
class HandPosture:
    """A posture by where the hand is.

    Attributes:
        place: (x, y, z) of the hand's frame in world [m].
        turn: Its rotation vector [rad]; None leaves the orientation free.
        elbow: Angle of the elbow (``robot.inverse_kinematics``) [rad]; None leaves it free.
    """

    place: tuple[float, float, float]
    turn: tuple[float, float, float] | None
    elbow: float | None


@dataclass(frozen=True)
class ArmSpec:
    """One impedance module: a limb, where it starts, its joint bias and its springs.

    Attributes:
        limb: Name of the limb in the robot file.
        posture: [rad] by short joint name: start, and rest of the joint bias. Empty as long as ``by_hand`` is not
            solved (``robot.hand_postures``).
        by_hand: The posture by its hand's pose; None where joint angles are given.
        mirror_of: Name of the arm whose image this one is; None where it is written out.
    """

    limb: str
    posture: Mapping[str, float]
    joint_bias: JointBiasSpec | None
    springs: tuple[SpringSpec, ...]
    by_hand: HandPosture | None = None
    mirror_of: str | None = None


@dataclass(frozen=True)
class ObjectSpec:
    """A rigid object that the named arms hold from the start.

    Attributes:
        held_by: Names of the arms.
        shape: ``box``, ``cylinder`` or ``sphere``.
        mass: [kg].
        size: Full edge lengths (box), (diameter, length) (cylinder) or (diameter,) (sphere) [m].
        position: Of the object's origin (its centre) in world at the start [m]; None puts it midway
            between the holding hands.
        grasp: ``weld``, or ``friction``, which slips at ``friction``.
        friction: Coefficient of a friction grasp; None for a weld.
        squeeze: Force with which each hand presses towards the object's origin [N]; 0 for none.
        carry_weight: The modules carry the object's declared weight.
        hinge: About which alone it can turn; None for a free object.
        centre: Of mass, from its origin along its own axes [m]. Zero in every task; a patch may say otherwise.
    """

    held_by: tuple[str, ...]
    shape: str
    mass: float
    size: tuple[float, ...]
    position: tuple[float, float, float] | None
    grasp: str
    friction: float | None
    squeeze: float
    carry_weight: bool
    hinge: HingeSpec | None = None
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class TankSpec:
    """Energy the controller may supply beyond its springs' declared potential [J]."""

    initial: float
    max: float
    floor: float


@dataclass(frozen=True)
class RoughnessSpec:
    """The texture of fresh wood; all of it wears off in proportion to one factor that goes from 1 to 0.

    Attributes:
        height: Of its highest peaks above smooth wood [m].
        wavelength: From peak to peak [m].
        friction: Coefficient that fresh wood adds to the surface's own.
        wear: Friction work that leaves 1/e of it [J/m^2].
    """

    height: float
    wavelength: float
    friction: float
    wear: float


@dataclass(frozen=True)
class SplintersSpec:
    """Splinters, evenly distributed; each catches a hand that comes near, holds it, and is gone once broken.

    Attributes:
        density: How many there are [1/m^2].
        force: Least and largest breaking force; each splinter has its own [N].
        endurance: For how long a splinter bears its breaking force [s].
        reach: How near the touching point must come [m].
    """

    density: float
    force: tuple[float, float]
    endurance: float
    reach: float


@dataclass(frozen=True)
class WoodSpec:
    """Wood on the top face of a box.

    Attributes:
        seed: Of where splinters stand, how strong they are, and how the texture runs.
        roughness: None for smooth wood.
        splinters: None for wood without.
    """

    seed: int
    roughness: RoughnessSpec | None
    splinters: SplintersSpec | None


@dataclass(frozen=True)
class SheetSpec:
    """A flexible sheet held down on supports: a beam along its own x axis (``plant.contact.sheet``).

    Attributes:
        supports: (x, height) of each in the sheet's axes, ascending in x [m].
        width: Across, along its y axis, half of it on either side [m].
        bending_stiffness: EI of the whole width [N.m^2].
    """

    supports: tuple[tuple[float, float], ...]
    width: float
    bending_stiffness: float


@dataclass(frozen=True)
class MeshSpec:
    """A closed body of triangles, in its own axes (``spec.surface_mesh`` reads it).

    Attributes:
        file: As the task names it.
        vertices: (v, 3) [m].
        triangles: (t, 3) indices of vertices, against the clock as seen from outside.
    """

    file: str
    vertices: Matrix = field(repr=False, compare=False)
    triangles: NDArray[np.int64] = field(repr=False, compare=False)


@dataclass(frozen=True)
class SurfaceSpec:
    """A compliant surface of the built-in plant.

    Attributes:
        surface: ``plane`` (horizontal half-space below ``height``), ``box``, ``cylinder``, ``sphere``, ``saddle``,
            ``mesh`` or ``sheet``.
        height: Of a plane, in world [m]; None for others.
        position: Centre of a body, middle of a saddle, or origin of the axes of a mesh or sheet, in world [m]; None
            for a plane.
        rotation: Rotation vector of the surface's axes, or tilt of a plane, in world [rad].
        size: Full edge lengths of a box (3) or a saddle (2), diameter and length of a cylinder, diameter of a
            sphere [m]; None for others.
        stiffness: Normal [N/m].
        damping: Normal [N.s/m].
        friction: Coulomb coefficient; of smooth wood where there is wood.
        wood: On the top face of a box; None for none.
        sheet: What makes a sheet one; None for others.
        radii: Radii of curvature of a saddle, upwards along x and downwards along y [m]; None for others.
        mesh: The triangles of a mesh; None for others.
    """

    surface: str
    height: float | None
    position: tuple[float, float, float] | None
    rotation: tuple[float, float, float]
    size: tuple[float, ...] | None
    stiffness: float
    damping: float
    friction: float
    wood: WoodSpec | None = None
    sheet: SheetSpec | None = None
    radii: tuple[float, float] | None = None
    mesh: MeshSpec | None = None

    @property
    def fresh_friction(self) -> float:
        """Coulomb coefficient of fresh wood; without wood, the surface's own."""
        rough = self.wood.roughness if self.wood is not None else None
        return self.friction + (rough.friction if rough is not None else 0.0)


@dataclass(frozen=True)
class PushSpec:
    """A wrench that pushes a hand or the held object of the built-in plant, whatever it moves.

    Attributes:
        target: Name of an arm (its hand) or ``object``.
        wrench: (6,) in world axes at the hand frame's or object's origin [N, N.m], what acts on it.
        start: When it begins, since the start of the run [s].
        rise: Minimum-jerk time to the full wrench [s]; 0 jumps.
        hold: For how long the full wrench acts [s].
        fall: Minimum-jerk time back to zero [s]; 0 drops at once.
    """

    target: str
    wrench: tuple[float, float, float, float, float, float]
    start: float
    rise: float
    hold: float
    fall: float


@dataclass(frozen=True)
class Sine:
    """Coordinate that oscillates: center + amplitude sin(2 pi frequency t); t from the phase's start.

    ``center`` None means the coordinate's value when the phase starts.
    """

    amplitude: float
    frequency: float
    center: float | None


Coordinate = float | Sine


@dataclass(frozen=True)
class ContactCondition:
    """Contact made (or lost, ``present`` False), judged from measured effort.

    Attributes:
        force: Threshold [N]; None takes the robot file's.
        time: For how long [s]; None takes the robot file's.
        target: ``object`` or an arm's name; None means the object when one is held, else any arm.
    """

    present: bool
    force: float | None
    time: float | None
    target: str | None


@dataclass(frozen=True)
class ReachedCondition:
    """Every moved target within ``distance`` [m] and ``angle`` [rad] of where the phase takes it."""

    distance: float
    angle: float


@dataclass(frozen=True)
class SmoothCondition:
    """What a hand rubs has become smooth, judged from its position and force (thesis 5.2.4).

    Attributes:
        target: Arm whose hand rubs.
        along: Strokes that count, a signed world axis, e.g. ``-x``.
        normal: Out of the surface, a signed world axis.
        by: ``spectrum`` (tangential force around 20 Hz, rms [N]) or ``friction`` (its coefficient).
        below: What the mean over the last windows must stay below [N] or [1].
        windows: How many windows.
        friction_below: What the coefficient of friction must stay below, too, where ``by`` is ``spectrum``; None where
            it does not count.
    """

    target: str
    along: str
    normal: str
    by: str
    below: float
    windows: int
    friction_below: float | None = None


@dataclass(frozen=True)
class PhaseSpec:
    """A stretch of the task with constant gains and one motion of its equilibria.

    Attributes:
        name: Unique within the task.
        duration: Minimum-jerk time to a new equilibrium, and longest time in the phase [s].
        equilibrium: Target (``object``, ``hinge``, ``<arm>.<spring>`` or a spring between two arms) -> axis ->
            coordinate, absolute in the spring's ``expressed_in`` (the object's: world; the hinge's: ``angle``). Omitted
            ones keep their value.
        posture: Arm -> short joint name -> new rest of the joint bias [rad].
        axes: ``<arm>.<spring>`` -> axis -> hybrid axis replacing that axis's during this phase and after.
        stiffness: ``<arm>.<spring>`` -> (6, 6) stiffness from this phase on.
        until: Ends the phase early; None runs for ``duration``.
        otherwise: ``stop`` (exit 3) or ``next`` when ``until`` is not met at ``duration``.
        blend: Time in which the gains come in [s]; None for half a second, or the whole of a shorter phase.
        listen: Targets whose equilibria follow set-points that arrive meanwhile; none for most phases.
        beyond_reach: Whether its targets may lie where no posture brings the frames: springs that only pull that way.
        submovements: Target -> minimum-jerk displacements that are added to its coordinates.
        grippers: Arm -> what is asked of its gripper when the phase begins.
        paths: Target -> path of a recording that it takes instead.
    """

    name: str
    duration: float
    equilibrium: Mapping[str, Mapping[str, Coordinate]]
    posture: Mapping[str, Mapping[str, float]]
    axes: Mapping[str, Mapping[str, HybridAxis]]
    stiffness: Mapping[str, Matrix]
    until: ContactCondition | ReachedCondition | SmoothCondition | GripperCondition | None
    otherwise: str
    listen: tuple[str, ...] = ()
    blend: float | None = None
    beyond_reach: bool = False
    submovements: Mapping[str, tuple[Submovement, ...]] = field(default_factory=dict)
    grippers: Mapping[str, GripperOrder] = field(default_factory=dict)
    paths: Mapping[str, PathSpec] = field(default_factory=dict)


@dataclass(frozen=True)
class TaskPlayback:
    """A task that is carried out by the robot's own playback of a joint path.

    Attributes:
        mode: ``position`` or ``velocity``: which of the robot's own modes plays.
        taught_on: Surfaces on which the task's springs lead the arm while the path is recorded.
    """

    mode: str
    taught_on: tuple[SurfaceSpec, ...]


@dataclass(frozen=True)
class TaskSpec:
    """A whole task file. ``document`` maps every value back to its line and column.

    ``set_points`` limits what arrives while it runs; None for a task that listens to nothing. ``between`` are the
    springs between two arms, ``obstacles`` push frames of the arms away.
    """

    name: str
    description: str
    robot: str
    arms: Mapping[str, ArmSpec]
    object: ObjectSpec | None
    tank: TankSpec
    environment: tuple[SurfaceSpec, ...]
    pushes: tuple[PushSpec, ...]
    phases: tuple[PhaseSpec, ...]
    path: Path
    text: str = field(repr=False)
    document: Document = field(repr=False, compare=False)
    playback: TaskPlayback | None = None
    set_points: SetPointLimits | None = None
    between: tuple[BetweenSpec, ...] = ()
    obstacles: tuple[ObstacleSpec, ...] = ()
