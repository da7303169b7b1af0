# SPDX-License-Identifier: BSD-3-Clause
r"""A recording as the effects' columns need it: sampled motion and torques of all joints, and the model.

Whoever filters the residual filters the columns alike; nothing is filtered here. Derivatives are central
differences of the eighth order, which bend nothing below a quarter of the sampling rate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from impedance_modules.arrays import Array
from impedance_modules.effects.carried_object import CarriedObject
from impedance_modules.effects.joint_motion import JointSample, follow, regularisation_velocity
from impedance_modules.effects.rigid_model import RigidModel
from impedance_modules.errors import BadInput
from impedance_modules.spec.robot_spec import EncoderSide
from impedance_modules.spec.task import SurfaceSpec

STENCIL = (4.0 / 5.0, -1.0 / 5.0, 4.0 / 105.0, -1.0 / 280.0)
"""Weights of the differences over two, four, six and eight steps (Fornberg 1988)."""


SMALL_SHIFT = 1e-3
"""Largest shift of a position over which the change of the links' torque is taken [rad]: the next order is 1e-7."""


def differentiate(values: Array, time: Array) -> Array:
    """Differentiates samples (N, ...) by time (N,), the last four at either end by their neighbours alone."""
    from scipy.ndimage import correlate1d  # noqa: PLC0415 - a slow import that a run does without

    steps, reach = np.diff(time), len(STENCIL)
    if len(time) <= 2 * reach or np.ptp(steps) > 1e-3 * steps[0]:
        return np.asarray(np.gradient(values, time, axis=0, edge_order=1))
    step = (time[-1] - time[0]) / len(steps)
    weights = np.array([*(-w for w in reversed(STENCIL)), 0.0, *STENCIL]) / step
    out = np.asarray(correlate1d(np.asarray(values, dtype=float), weights, axis=0, mode="nearest"))
    out[0], out[-1] = (values[1] - values[0]) / step, (values[-1] - values[-2]) / step
    out[1:reach] = (values[2 : reach + 1] - values[: reach - 1]) / (2.0 * step)
    out[-reach:-1] = (values[-reach + 1 :] - values[-reach - 1 : -2]) / (2.0 * step)
    return out


def lagged(values: Array, time: Array, constant: float, start: float | None = None) -> Array:
    """Follows values (N,) with a first-order lag; exact for straight pieces between samples.

    Args:
        values: (N,) at the times.
        time: (N,) [s].
        constant: Time constant [s].
        start: What the lag gives at first; None where it has settled.
    """
    if constant < 1e-9:
        return values.copy()
    first = float(values[0]) if start is None else start
    steps = np.diff(time)
    keep = np.exp(-steps / constant)
    # Over a straight piece u(s) = u_0 + r s the lag's particular solution is u(s) - r T.
    behind = np.diff(values) / steps * constant
    # state' = keep state + push, one first-order filter where the steps are even.
    push = values[1:] - behind - keep * (values[:-1] - behind)
    if np.ptp(steps) < 1e-6 * steps[0]:
        from scipy.signal import lfilter  # noqa: PLC0415 - a slow import that a run does without

        before = np.array([keep[0] * first])
        return np.concatenate([[first], lfilter([1.0], [1.0, -keep[0]], push, zi=before)[0]])
    out = np.empty_like(values)
    out[0] = state = first
    for i in range(steps.size):
        out[i + 1] = state = keep[i] * state + push[i]
    return out


def low_passed(values: Array, rate: float, cutoffs: Array) -> Array:
    """Filters samples (N, k, ...) with zero phase, each of the k series below a frequency of its own (k,) [Hz]."""
    from scipy.signal import sosfiltfilt  # noqa: PLC0415 - a slow import that a run does without

    out = np.empty_like(values)
    for j, cutoff in enumerate(cutoffs):
        sections = _low_pass(min(float(cutoff), 0.4 * rate) / rate)
        # A short segment is continued by all that it has.
        continued = min(3 * (2 * len(sections) + 1), len(values) - 1)
        out[:, j] = sosfiltfilt(sections, values[:, j], axis=0, padlen=continued)
    return out


@lru_cache(maxsize=256)
def _low_pass(cutoff: float) -> Array:
    """Sections of a filter below a frequency [cycles per sample]; hundreds of columns pass the same one."""
    from scipy.signal import butter  # noqa: PLC0415 - a slow import that a run does without

    return np.asarray(butter(4, cutoff, fs=1.0, output="sos"))


@dataclass(frozen=True)
class Signals:
    r"""One recording, all (N, n) in the rigid model's joint order.

    Attributes:
        model: Nominal links.
        time: (N,) [s].
        position, velocity, acceleration: Of the links, as measured, [rad], [rad/s], [rad/s^2].
        effort: As measured [N.m]; None if not recorded.
        drive: Torque asked of the motor: the command plus what the robot adds by itself [N.m], or None.
        position_command: [rad], or None.
        aimed: ``position_command`` with the tracking error that follows from the commanded motion alone, or None.
        reflected_inertia, motor_damping: (n,) nominal I_r [kg.m^2] and D [N.m.s/rad].
        spring_compliance: (n,) nominal 1 / K_sea [rad/(N.m)], 0 for a rigid joint.
        effort_source: ``joint_sensor``: between gear and link; ``motor``: before rotor inertia and friction.
        encoders: Side of each joint's gear and spring on which its position was measured; None, or none at all, where
            nobody says. ``position`` is the link's in any case, as far as the nominal springs tell.
        deflection_cutoffs: (n,) frequency up to which a load may be differentiated twice without being mostly noise of
            positions [Hz]; None where there is none.
        spring_reading: ``effort`` of a joint sensor as it was read, where ``effort`` was cleaned: what bends a spring.
        assistance: Part of ``drive`` that the robot adds by itself, which no delay of the command touches;
            None where it adds nothing.
        surfaces: What the hands could press on, as the task has it; empty where nobody says.
        hands: Links whose origins touch them.
        carried: Object that a hand holds, as the task has it; None where nobody says.
        clean_drive: ``drive`` without its noise, where that is known; a law that smooths what was asked for would
            otherwise gain by smoothing the noise that the residual carries too.
        clean_acceleration: ``acceleration`` as far as it is motion; None where nobody says. Columns are made of it.
        reading: ``effort`` as it was read, where ``effort`` was cleaned: for laws that need no more than its sign.
        reported_velocity: As reported beside the positions [rad/s], or None.
        velocity_filter: Time constant of the first-order lag that the robot file states of these [s].
        path_before: (K, n) positions before the first sample, from which bristles are bent [rad], or None.
    """

    model: RigidModel
    time: Array
    position: Array
    velocity: Array
    acceleration: Array
    effort: Array | None
    drive: Array | None
    position_command: Array | None
    reflected_inertia: Array
    motor_damping: Array
    spring_compliance: Array
    effort_source: Literal["joint_sensor", "motor"]
    encoders: tuple[EncoderSide | None, ...] = ()
    deflection_cutoffs: Array | None = None
    spring_reading: Array | None = None
    assistance: Array | None = None
    clean_drive: Array | None = None
    clean_acceleration: Array | None = None
    surfaces: tuple[SurfaceSpec, ...] = ()
    hands: tuple[str, ...] = ()
    carried: CarriedObject | None = None
    reading: Array | None = None
    reported_velocity: Array | None = None
    velocity_filter: float = 0.0
    path_before: Array | None = None
    aimed: Array | None = None

    @property
    def samples(self) -> int:
        """Number of samples."""
        return int(self.time.size)

    @property
    def n(self) -> int:
        """Number of joints."""
        return int(self.position.shape[1])

    def joint(self, name: str) -> int:
        """Finds a joint's column.

        Raises:
            BadInput: The recording has no such joint.
        """
        if name not in self.model.joint_names:
            raise BadInput(f"no joint '{name}' (valid: {', '.join(self.model.joint_names)})")
        return self.model.joint_names.index(name)

    def rate_of(self, values: Array) -> Array:
        """Differentiates samples by time along the first axis."""
        return differentiate(values, self.time)

    @cached_property
    def rigid(self) -> Array:
        """ID(q, v, a) of the nominal links (N, n) [N.m]."""
        return self.model.torque(self.position, self.velocity, self.acceleration)

    @cached_property
    def torque_of_aim(self) -> tuple[Array, Array]:
        """Torque and weight of the nominal links in the motion asked for, (N, n) each [N.m]; none without one."""
        aim = self.position_command
        if aim is None:
            return np.zeros_like(self.position), np.zeros_like(self.position)
        rate, still = self.rate_of(aim), np.zeros_like(aim)
        return self.model.torque(aim, rate, self.rate_of(rate)), self.model.torque(aim, still, still)

    @cached_property
    def weight(self) -> Array:
        """g(q) of the nominal links (N, n) [N.m]."""
        return self.model.weight(self.position)

    @property
    def measures_springs(self) -> bool:
        """Whether a sensor measures the torque between gear and link, which bends the joints' springs."""
        return self.effort is not None and self.effort_source == "joint_sensor"

    @cached_property
    def load(self) -> Array:
        """Torque between gear and link (N, n) [N.m]: measured by a joint sensor, else the model's."""
        return self.effort if self.effort is not None and self.measures_springs else self.rigid

    @cached_property
    def slow_load(self) -> Array:
        """The load (N, n) [N.m] as read, or the model's, up to where its second derivative becomes noise."""
        return self.slowly(self.load if self.spring_reading is None else self.spring_reading, range(self.n))

    def slowly(self, loads: Array, joints: Sequence[int]) -> Array:
        """Leaves of loads (N, k, ...) of some joints what is slow enough to be differentiated twice."""
        if self.deflection_cutoffs is None:
            return loads
        rate = (self.samples - 1) / (self.time[-1] - self.time[0])
        return low_passed(loads, rate, self.deflection_cutoffs[list(joints)])

    @property
    def touch(self) -> Array:
        """The load (N, n) [N.m] as it was read: which flanks of the teeth carry it."""
        if self.reading is not None and self.measures_springs:
            return self.reading
        return self.load

    @cached_property
    def _deflection(self) -> Array:
        """Theta - q by the nominal springs (N, n) [rad]; of a load that accelerations make, what is no noise."""
        return (self.load if self.measures_springs else self.slow_load) * self.spring_compliance

    def encoder(self, joint: int) -> EncoderSide | None:
        """Side on which a joint's position was measured; the link's of a stated spring of which no more is said."""
        stated = self.encoders[joint] if self.encoders else None
        return "link" if stated is None and self.spring_compliance[joint] else stated

    @cached_property
    def encoder_at_motor(self) -> NDArray[np.bool_]:
        """Which joints' encoders (n,) sit at their motors."""
        return np.array([self.encoder(joint) == "motor" for joint in range(self.n)], dtype=bool)

    def through_springs(self, torque: Array, joints: Sequence[int], *, of_accelerations: bool) -> Array:
        r"""Computes what torques of links (N, k, ...) cost their motors, behind springs that no sensor measures.

            \tau + (I_r d^2/dt^2 + D d/dt) \tau / K

        The model's own load bends the nominal springs; torque beyond it bends them further, and turns the rotors too.
        A rotor whose own encoder is read moves as that says.

        Args:
            torque: [N.m].
            joints: Its k joints.
            of_accelerations: Measured accelerations make it: it bends springs as far as it is slow.
        """
        compliance = (self.spring_compliance * ~self.encoder_at_motor)[list(joints)]
        if self.measures_springs or not compliance.any():
            return torque
        shape = (1, -1, *(1,) * (torque.ndim - 2))
        bent = compliance.reshape(shape) * (self.slowly(torque, joints) if of_accelerations else torque)
        inertia, damping = (part[list(joints)] for part in (self.reflected_inertia, self.motor_damping))
        rate = self.rate_of(bent)
        return np.asarray(
            torque + inertia.reshape(shape) * self.rate_of(rate) + damping.reshape(shape) * rate
        )

    @cached_property
    def encoder_position(self) -> Array:
        """Positions (N, n) where the encoders sit [rad]."""
        return self.position + self._deflection * self.encoder_at_motor

    @cached_property
    def encoder_velocity(self) -> Array:
        """Speeds (N, n) where the encoders sit [rad/s]."""
        return np.where(self.encoder_at_motor, self.motor_velocity, self.velocity)

    @cached_property
    def stated_velocity(self) -> Array:
        """Those speeds (N, n) as the stated filter reports them, from what was reported at first on [rad/s].

        A segment begins in the middle of a motion.
        """
        first = self.encoder_velocity[0] if self.reported_velocity is None else self.reported_velocity[0]
        columns = zip(self.encoder_velocity.T, first.tolist(), strict=True)
        return np.column_stack(
            [lagged(column, self.time, self.velocity_filter, start) for column, start in columns]
        )

    def torque_of_shift(self, joint: int, shift: Array) -> Array:
        r"""Computes how ID changes as one joint's path is shifted by a small \delta (N,), to first order, (N, n) [N.m].

        (dID/dq) \delta + (dID/dv) \dot\delta + M \ddot\delta, by a central difference along the path.
        """
        rate = self.rate_of(shift)
        scale = SMALL_SHIFT / max(float(np.abs(shift).max()), 1e-300)
        moves = [scale * part for part in (shift, rate, self.rate_of(rate))]
        ends = []
        for way in (1.0, -1.0):
            motion = [part.copy() for part in (self.position, self.velocity, self.acceleration)]
            for part, move in zip(motion, moves, strict=True):
                part[:, joint] += way * move
            ends.append(self.model.torque(*motion))
        return np.asarray((ends[0] - ends[1]) / (2.0 * scale))

    @cached_property
    def motor_velocity(self) -> Array:
        r"""Speed of the motors \dot\theta = v + d(load)/dt / K, (N, n) [rad/s]."""
        if not self.spring_compliance.any():
            return self.velocity
        return self.velocity + self.rate_of(self._deflection)

    @cached_property
    def motor_acceleration(self) -> Array:
        """Acceleration of the motors (N, n) [rad/s^2]."""
        if not self.spring_compliance.any():
            return self.acceleration
        return self.acceleration + self.rate_of(self.motor_velocity - self.velocity)

    @cached_property
    def position_derivative(self) -> Array:
        """D ID / dq (N, n, n)."""
        return self.model.position_derivative(self.position, self.velocity, self.acceleration)

    @cached_property
    def weight_columns(self) -> Array:
        """Dg / d(gravity) (N, n, 3)."""
        return self.model.weight_columns(self.position)

    def body_columns(self, body: str) -> Array:
        r"""D ID / d\pi of a link (N, n, 10), computed once."""
        kept: dict[str, Array] = self.__dict__.setdefault("_body_columns", {})
        if body not in kept:
            kept[body] = self.model.body_columns(body, self.position, self.velocity, self.acceleration)
        return kept[body]

    def bristles(self, joint: int, stretch: float, exponent: float, *, motor_side: bool) -> Array:
        """Bend of bristles along a joint's path (N,), unbent where the recording began; computed once."""
        kept: dict[tuple[int, float, float, bool], Array] = self.__dict__.setdefault("_bristles", {})
        key = (joint, stretch, exponent, motor_side)
        if key not in kept:
            path, earlier = self.sample(joint, motor_side=motor_side).position, np.zeros(0)
            if self.path_before is not None:
                earlier = self.path_before[:, joint] + (path[0] - self.position[0, joint])
            kept[key] = follow(np.concatenate([earlier, path]), stretch, exponent)[earlier.size :]
        return kept[key]

    def sample(self, joint: int, *, motor_side: bool) -> JointSample:
        """Gives one joint's motion on one side of its gear."""
        side = (
            (self.motor_velocity, self.motor_acceleration)
            if motor_side
            else (self.velocity, self.acceleration)
        )
        position = self.position[:, joint]
        if motor_side and self.spring_compliance[joint]:
            position = position + self._deflection[:, joint]
        return JointSample(
            self.time,
            position,
            side[0][:, joint],
            side[1][:, joint],
            self.load[:, joint],
            regularisation=float(regularisation_velocity(self.model.sliding)[joint]),
        )
