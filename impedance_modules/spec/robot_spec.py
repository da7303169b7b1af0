# SPDX-License-Identifier: BSD-3-Clause
"""What a robot file says, as frozen data: limbs, limits, elastic joints, timing, sensors.

No joint or limb name of any robot is known here; they come from ``robots/<name>/robot.yaml``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from impedance_modules.spec.gripper_spec import GripperSpec

STANDARD_GRAVITY = 9.81
"""Acceleration of free fall, everywhere in this package and its plant [m/s^2]."""

UPRIGHT_GRAVITY = (0.0, 0.0, -STANDARD_GRAVITY)
"""Gravity's acceleration in world axes, and in the axes of a base that stands upright [m/s^2]."""

EncoderSide = Literal["link", "motor"]
"""Side of a joint's gear and spring on which its position is measured."""


@dataclass(frozen=True)
class JointSpec:
    """One joint: limits and drive, in rad, N.m and seconds.

    Attributes:
        name: Joint name in the URDF.
        position_min, position_max: [rad].
        velocity_max: Declared bound of the motor-side speed [rad/s].
        effort_max: [N.m].
        effort_rate_max: [N.m/s].
        spring_stiffness: Series-elastic stiffness K_sea [N.m/rad]; None for a rigid joint.
        reflected_inertia: Rotor inertia seen at the joint, I_r [kg.m^2]; 0 is an ideal torque source.
        motor_damping: Viscous friction of the motor, D [N.m.s/rad].
        spring_damping: Structural damping in parallel to K_sea [N.m.s/rad].
        encoder: Side on which its position is measured; None where nobody says, and the link's is taken.
    """

    name: str
    position_min: float
    position_max: float
    velocity_max: float
    effort_max: float
    effort_rate_max: float
    spring_stiffness: float | None
    reflected_inertia: float
    motor_damping: float
    spring_damping: float
    encoder: EncoderSide | None = None


@dataclass(frozen=True)
class LimbSpec:
    """A chain of joints that ends in a hand.

    Attributes:
        name: e.g. what the task file calls it under ``arms``.
        hand: Frame (link) of the hand in the URDF.
        joints: Short joint name -> URDF joint name, from the base outwards.
        gripper: At the hand; None where it has none.
    """

    name: str
    hand: str
    joints: Mapping[str, str]
    gripper: GripperSpec | None = None


@dataclass(frozen=True)
class MirrorSpec:
    """How one limb is the mirror image of another.

    Attributes:
        plane: ``xz``: poses, wrenches, stiffness and targets by diag(1, -1, 1, -1, 1, -1); ``yz`` and
            ``xy`` likewise.
        joint_sign: Short joint name -> +1 or -1; empty where no signs make one arm the image of the other.
        joint_offset: Short joint name -> what is added to the signed angle [rad]; 0 for joints left out.
    """

    plane: str
    joint_sign: Mapping[str, int]
    joint_offset: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class TimingSpec:
    """Rates and delays [Hz], [s].

    Attributes:
        rate: Control rate unless the run says otherwise.
        rate_min, rate_max: What the robot accepts.
        command_delay: From a state sample to the torque acting, beyond the period itself.
        command_timeout: After which the robot drops the last command.
    """

    rate: float
    rate_min: float
    rate_max: float
    command_delay: float
    command_timeout: float


@dataclass(frozen=True)
class SensorSpec:
    """Resolution and noise of the joint sensors.

    Attributes:
        position_resolution: Grid of the reported position [rad]; 0 for none.
        effort_resolution: Grid of the reported effort [N.m]; 0 for none.
        position_noise: Standard deviation [rad].
        effort_noise: Standard deviation [N.m].
        velocity_filter: Time constant of the robot's velocity estimate [s]; 0 differentiates.
    """

    position_resolution: float
    effort_resolution: float
    position_noise: float
    effort_noise: float
    velocity_filter: float


ROBOT_LOOP_PERIOD = 1e-3
"""Longest sampling of the robot's own loops: weight compensation, velocity estimate, torque feedback [s]."""


@dataclass(frozen=True)
class InnerTorqueLoopSpec:
    """The robot's own feedback of the torque in its joints' springs to their motors.

    Attributes:
        gain: k, the same for every joint [1].
        delay: Of the measured torque, beyond the loop's own sampling [s].
    """

    gain: float
    delay: float

    @property
    def lighter(self) -> float:
        """1 + k, over which a rotor's inertia and damping count for a commanded torque (thesis 3.2)."""
        return 1.0 + self.gain


@dataclass(frozen=True)
class ContactDetectionSpec:
    """When effort alone says that a hand touches something: force [N] held for a time [s]."""

    force: float
    time: float


@dataclass(frozen=True)
class PlaybackSpec:
    """How the robot itself plays a recorded joint path back, and when it gives up.

    Attributes:
        rate: Of the server that commands the joints [Hz].
        position_tolerance: Distance of a joint from its path that ends a playback in position mode [rad].
        velocity_gain: Commanded speed over distance from the path in velocity mode [1/s].
        speed_ratio: Share of the top speed in position mode.
        position_lag: By which position mode trails a moving command [s].
        integral_rate, integral_limit: Integral action of the servo [1/s] and its limit [rad].
        swing_feedback: Feedback of the links' swing, over sqrt(M_ii / K).
        impact, squish: Short joint name -> sudden and steady torque that count as a collision [N.m].
        impact_time, squish_time: Low pass behind the one, duration of the other [s].
        pause: For how long a collided limb takes no commands [s].
    """

    rate: float
    position_tolerance: float
    velocity_gain: float
    speed_ratio: float
    position_lag: float
    integral_rate: float
    integral_limit: float
    swing_feedback: float
    impact: Mapping[str, float]
    impact_time: float
    squish: Mapping[str, float]
    squish_time: float
    pause: float


@dataclass(frozen=True)
class CollisionSpec:
    """Distance rows.

    Attributes:
        pairs: Pairs of link names whose distance is kept.
        margin: Distance below which a pair pushes back [m].
    """

    pairs: tuple[tuple[str, str], ...]
    margin: float


@dataclass(frozen=True)
class BodyChange:
    """What a link has beyond its URDF, e.g. a tool that a patch describes.

    Attributes:
        link: Name in the URDF.
        parameters: Ten numbers in the link's frame, inertia about its origin: mass [kg], first moments x, y, z
            [kg.m], inertia xx, xy, yy, xz, yz, zz [kg.m^2].
    """

    link: str
    parameters: tuple[float, ...]


@dataclass(frozen=True)
class ParallelSpringSpec:
    """A spring beside a joint's drive: torque preload - stiffness q on the joint [N.m/rad], [N.m]."""

    stiffness: float
    preload: float


@dataclass(frozen=True)
class AssumedNumber:
    """Numbers of a robot file that nobody has published or measured.

    Attributes:
        key: What the list ``assumed`` calls them.
        line: Where it does so in ``robot.yaml``.
    """

    key: str
    line: int


@dataclass(frozen=True)
class JointOrigin:
    """Where a joint sits in its parent link, as a URDF says it.

    Attributes:
        translation: x, y, z [m].
        roll_pitch_yaw: Rotation about fixed x, then y, then z [rad].
    """

    translation: tuple[float, float, float]
    roll_pitch_yaw: tuple[float, float, float]


@dataclass(frozen=True)
class RobotSpec:
    """A whole robot folder.

    Attributes:
        gravity_compensation: What compensates the arms' weight: ``robot``, ``command`` or ``none``.
        control_modes: e.g. ``("torque", "position", "velocity")``.
        solver: ``daqp``, ``proxsuite`` or ``qpsolvers:<name>``.
        joints: URDF joint name -> its numbers, for every joint of every limb.
        locked: URDF joints that stay where they are -> their angle [rad].
        folder: The robot's folder; ``urdf`` lies in it.
        body_changes: What a patch adds to links; none in a robot file.
        parallel_springs: URDF joint name -> spring that a patch adds; none in a robot file.
        gravity: Acceleration in the base's axes [m/s^2]; upright unless a patch tilts the base.
        joint_origins: URDF joint name -> where this very robot has been calibrated to have it; none in a robot file.
        playback: The robot's own way to play a joint path back; None where it has none.
        inner_torque_loop: The robot's own feedback of torque; None where it has none.
        postures: Name -> limb -> angle by short joint name [rad], all joints of the limb.
        assumed: What in the file is a cautious guess.
    """

    name: str
    urdf: Path
    limbs: Mapping[str, LimbSpec]
    joints: Mapping[str, JointSpec]
    locked: Mapping[str, float]
    mirror: MirrorSpec | None
    timing: TimingSpec
    sensors: SensorSpec
    contact_detection: ContactDetectionSpec
    collision: CollisionSpec
    gravity_compensation: str
    control_modes: tuple[str, ...]
    solver: str
    folder: Path
    body_changes: tuple[BodyChange, ...] = ()
    parallel_springs: Mapping[str, ParallelSpringSpec] = field(default_factory=dict)
    gravity: tuple[float, float, float] = UPRIGHT_GRAVITY
    joint_origins: Mapping[str, JointOrigin] = field(default_factory=dict)
    playback: PlaybackSpec | None = None
    inner_torque_loop: InnerTorqueLoopSpec | None = None
    postures: Mapping[str, Mapping[str, Mapping[str, float]]] = field(default_factory=dict)
    assumed: tuple[AssumedNumber, ...] = ()
