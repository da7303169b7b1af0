# SPDX-License-Identifier: BSD-3-Clause
"""How large an effect looks in what was logged, over the noise there, and how to give it a wanted size.

The nominal arm is laid over a recording. With u the command and the weight that the robot adds, e the effort, I, D, K,
B of the drives, T the stated filter of the velocity, one residual for each pair of channels, below `BAND`:

    link      e + B e' / K - ID(q, v, a)                                 joint sensor
    actuator  u - e - B e' / K - I theta'' - D theta',  theta = q + e / K     joint sensor and command
    motor     e - ID(q, v, a) - I theta'' - D theta', theta = q + ID / K motor torque
    drive     u - e                                                      motor torque and command
    whole     u - ID(q, v, a) - I theta'' - D theta'                        command alone
    velocity  v_said + T v_said' - v

The size is the rms of what an effect adds to a residual without noise, less what links wrong by 3 % could imitate,
over the rms of what the noise adds there; the largest over joints and residuals counts. Beside it stands the share of
the joint's range of torque (of speed) that the effect's rms is: gaps below 1 % are small by the tool's own rule.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from benchmarks.blind.arm_model import Inertial, Link
from benchmarks.blind.injection import Injection
from benchmarks.blind.plant import Arm
from benchmarks.blind.residual import net_of_inertias
from benchmarks.wide.arms import DOWN, WideArm
from benchmarks.wide.logs import record
from benchmarks.wide.mujoco_engine import Rigid
from benchmarks.wide.plan import Plan, RawLog

Array = NDArray[np.float64]

BAND = 6.0
"""Hz; the highest frequency that counts."""
ALIKE = 20.0
"""Sum of squares over noise below which two causes count as one in a recording."""
PRIOR = 0.03
EDGE = 0.6
"""Seconds left out at each end."""
SHARE = 0.015
"""Of the joint's range that a planted effect shall have at least."""
Simulate = Callable[[Plan], RawLog]


@dataclass(frozen=True)
class Size:
    """Net rms over noise, share of the joint's range, residual and joint index where the first is largest."""

    net: float
    share: float
    residual: str
    joint: int

    def over(self, wanted: float) -> float:
        """Returns by how much the smaller of both exceeds what is wanted."""
        return min(self.net / wanted, self.share / SHARE)


class Scale:
    """Sizes of effects on one motion of an arm."""

    def __init__(self, arm: WideArm, reference: Array, seed: int, simulate: Simulate) -> None:
        """Simulates the arm as it is without noise, and with it."""
        self._arm, self._reference, self._simulate = arm, reference, simulate
        self._model = Rigid(arm.machine.links, arm.machine.hand, DOWN)
        channels = self.channels(arm, None)
        self._quiet = residuals(channels, arm, self._model)
        noisy = residuals(self.channels(arm, seed), arm, self._model)
        few = self._few
        self.noise = {
            name: np.sqrt(np.mean((noisy[name] - self._quiet[name])[few] ** 2, axis=0)) + 1e-12
            for name in noisy
        }
        self._channels = channels

    def channels(self, arm: WideArm, seed: int | None) -> dict[str, Array]:
        """Returns what would be logged, evenly; stamps that run fast are kept under ``period``."""
        channels, rows = record(self._simulate(arm.plan(self._reference, seed)), arm, None)
        return channels | {"period": np.array(np.median(np.diff(rows.stamps)))}

    @property
    def _few(self) -> slice:
        """Samples that are about independent, without the ends."""
        rate = float(self._arm.values["rate"])
        cut = round(EDGE * rate)
        return slice(cut, -cut, max(1, round(rate / (2.5 * BAND))))

    @cached_property
    def _ranges(self) -> dict[str, Array]:
        q, v, a = motion_of(self._channels["position"], 1 / float(self._arm.values["rate"]))
        torque = dynamics(self._model, q, v, a)[self._few]
        speed = v[self._few]
        return {name: np.ptp(speed if name == "velocity" else torque, axis=0) + 1e-9 for name in self._quiet}

    @cached_property
    def _inertia(self) -> Array:
        """(samples, n, p): change of a torque residual for 3 % of each inertial number."""
        q, v, a = (
            one[self._few]
            for one in motion_of(self._channels["position"], 1 / float(self._arm.values["rate"]))
        )
        links, machine = self._arm.machine.links, self._arm.machine
        base, found = dynamics(self._model, q, v, a), []
        for at, link in enumerate(links):
            for changed in _variants(link):
                varied = (*links[:at], changed, *links[at + 1 :])
                found.append(dynamics(Rigid(varied, machine.hand, DOWN), q, v, a) - base)
        return np.stack(found, axis=-1)

    def signature(self, injection: Injection, amplitude: float) -> dict[str, Array]:
        """Returns what an effect adds to each residual (samples, n), in units of noise, net of inertias."""
        changed: Arm = injection.apply(self._arm, amplitude, 0)
        seen = residuals(self.channels(changed, None), self._arm, self._model)  # type: ignore[arg-type]
        found = {}
        for name, values in seen.items():
            change = (values - self._quiet[name])[self._few]
            if name in ("link", "motor", "whole"):
                found[name] = net_of_inertias(change, self.noise[name], self._inertia)
            else:
                found[name] = change / self.noise[name]
        return found

    def size(self, injection: Injection, amplitude: float) -> Size:
        """Returns the size of an effect."""
        return self.size_of(self.signature(injection, amplitude))

    def size_of(self, signature: Mapping[str, Array]) -> Size:
        """Returns the size of what an effect adds."""
        best = Size(0.0, 0.0, "", 0)
        for name, values in signature.items():
            rms = np.sqrt(np.mean(values**2, axis=0))
            joint = int(np.argmax(rms))
            if rms[joint] > best.net:
                share = float((rms * self.noise[name] / self._ranges[name])[joint])
                best = Size(float(rms[joint]), share, name, joint)
        return best

    def tune(self, injection: Injection, wanted: float, tries: int = 3) -> tuple[float, Size]:
        """Returns the amplitude whose size is 1 to 1.4 times what is wanted, or as near as physics lets."""
        amplitude, tried = injection.first, []
        for _ in range(tries):
            size = self.size(injection, amplitude)
            over = size.over(wanted)
            tried.append((abs(np.log(max(over, 1e-6) / 1.15)), amplitude, size))
            if 1.0 <= over <= 1.4 or over * injection.most < 0.4 * amplitude:
                break  # reached, or out of reach
            nearer = min(amplitude * float(np.clip(1.18 / max(over, 1e-6), 0.02, 30.0)), injection.most)
            if nearer == amplitude:
                break
            amplitude = nearer
        _, amplitude, size = min(tried, key=lambda one: one[0])
        return amplitude, size

    def alike(self, one: Injection, amplitude: float, size: Size, other: Injection) -> bool:
        """Tells whether another effect, at its best amplitude, leaves too little of this one to tell them apart."""
        seen = self.signature(one, amplitude)
        against = other.first
        for _ in range(2):
            found = self.size(other, against)
            against = min(against * float(np.clip(size.net / max(found.net, 1e-6), 0.02, 30.0)), other.most)
        return left_by(self.signature(other, against), seen) < ALIKE


def left_by(imitation: Mapping[str, Array], seen: Mapping[str, Array]) -> float:
    """Returns what one effect, at the amplitude that imitates another best, leaves of it: squares over noise."""
    first, second = (
        np.concatenate([part[name].ravel() for name in sorted(part)]) for part in (seen, imitation)
    )
    left = first - first @ second / max(float(second @ second), 1e-12) * second
    return float(left @ left)


def residuals(channels: Mapping[str, Array], arm: WideArm, model: Rigid) -> dict[str, Array]:
    """Returns every residual that the channels allow, (samples, n) each."""
    period, drive = float(channels["period"]), arm.drive
    q, v, a = motion_of(channels["position"], period)
    found: dict[str, Array] = {}
    still = np.zeros_like(q)
    inverse = dynamics(model, q, v, a)
    sprung = inverse - drive.spring_damping / drive.spring_stiffness * rate_of(inverse, period)
    twisted = q + sprung / drive.spring_stiffness
    rotors = drive.motor_damping * rate_of(twisted, period)
    rotors += drive.rotor_inertia * rate_of(rate_of(twisted, period), period)
    command = None
    if "effort_command" in channels:
        command = _shift(channels["effort_command"], drive.command_delay + 0.0005, period)
        if arm.values["gravity"].startswith("robot"):
            command = command + dynamics(model, channels["position"], still, still)
        command = low_pass(command, period)
    if "effort" in channels:
        e = low_pass(channels["effort"], period)
        if arm.sensing is not None and arm.sensing.effort_source == "motor":
            found["motor"] = e - inverse - rotors
            if command is not None:
                found["drive"] = command - e
        else:
            twist = e / drive.spring_stiffness
            slip = drive.spring_damping * rate_of(twist, period)
            found["link"] = e + slip - inverse
            if command is not None:
                theta = q + twist
                turning = drive.motor_damping * rate_of(theta, period)
                turning += drive.rotor_inertia * rate_of(rate_of(theta, period), period)
                found["actuator"] = command - e - slip - turning
    elif command is not None:
        found["whole"] = command - inverse - rotors
    if "velocity" in channels:
        told = low_pass(channels["velocity"], period)
        found["velocity"] = told + drive.velocity_filter * rate_of(told, period) - v
    return found


def motion_of(position: Array, period: float) -> tuple[Array, Array, Array]:
    """Returns position, speed and acceleration below the band."""
    q = low_pass(position, period)
    v = rate_of(q, period)
    return q, v, rate_of(v, period)


def low_pass(values: Array, period: float) -> Array:
    """Removes what is faster than `BAND`, without delay."""
    return np.asarray(sosfiltfilt(butter(3, BAND * period * 2, output="sos"), values, axis=0))


def rate_of(values: Array, period: float) -> Array:
    """Derivative by central differences of the eighth order."""
    padded = np.pad(values, ((4, 4), (0, 0)), mode="edge")
    total, last = np.zeros_like(values), padded.shape[0]
    for reach, weight in enumerate((4 / 5, -1 / 5, 4 / 105, -1 / 280), start=1):
        total += weight * (padded[4 + reach : last - 4 + reach] - padded[4 - reach : last - 4 - reach])
    return np.asarray(total / period)


def dynamics(model: Rigid, q: Array, v: Array, a: Array) -> Array:
    """Returns the torques (samples, n) of a motion."""
    return np.stack([model.torque(*row) for row in zip(q, v, a, strict=True)])


def _shift(values: Array, delay: float, period: float) -> Array:
    time = np.arange(values.shape[0]) * period
    return np.stack([np.interp(time - delay, time, column) for column in values.T], axis=1)


def _variants(link: Link) -> list[Link]:
    part = link.inertial
    if part is None or part.mass < 1e-4:
        return []
    found = [Inertial(part.mass * (1 + PRIOR), part.com, part.inertia * (1 + PRIOR))]
    reach = PRIOR * float(np.linalg.norm(part.com))
    found += [Inertial(part.mass, part.com + reach * axis, part.inertia) for axis in np.eye(3)]
    found += [Inertial(part.mass, part.com, part.inertia * (1 + PRIOR))]
    return [replace(link, inertial=one) for one in found]
