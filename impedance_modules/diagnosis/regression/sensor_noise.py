# SPDX-License-Identifier: BSD-3-Clause
r"""Noise of positions and torques in the residuals: what repeats do not show of it, and how it changes with the motion.

Two runs that agree to less than a count are rounded alike: their difference does not hold the rounding, the
residual does. A grid's errors (`data.encoder_grid`), differentiated twice, move the links. What the grid alone would
make of the accelerations, less what the repeats show of it, is added to the repeats' difference; without repeats the
noise beyond the motion's frequencies and the grid's errors bound the floor from below:

    \delta r_link = -M(q) \delta a,      \delta r_actuator = -I_r \delta a,      \delta r_velocity = -\delta v

Behind a spring 1/c whose torque no sensor measures, the rotor's acceleration is \delta a + c M(q) \delta a''; where the
encoder sits at the rotor, the link's is \delta a - c M(q) \delta a''.

The noise of a residual changes with the motion: an outstretched arm has more inertia, a heavy load shakes it.

    var(e - ID) = k^2 \sigma_e^2 + S,   S of M(q) \delta a

The floor shows the whole at its own recordings' poses and speeds; S is what the noise of positions makes at each
recording's, by their spectrum beyond the motion, or by their grid; the rest is the sensors' \sigma_e. (Repeats would
show S too if their motions were the same. They are not: arms answer noise and stamps by accelerations that are real,
and ten times those that positions' noise pretends.) k is how much noisier a recording's torque sensors are, by their
spectrum beyond the motion: many sensors' noise grows with the load.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.data.rigid_dynamics import mass_matrix
from impedance_modules.diagnosis.regression.candidates import Group
from impedance_modules.diagnosis.residuals.band import NOISE_ONLY, periodogram
from impedance_modules.diagnosis.residuals.preparation import Prepared
from impedance_modules.effects.recorded_signals import differentiate, low_passed
from impedance_modules.effects.residual_kinds import COVERS, EFFORT_SIGN, uses_motion

LACKING = 0.5
"""Repeats that show less than this part of a grid's noise are taken to have repeated its rounding."""

SENSOR_MIN = 0.05
"""Least part of the noise that is the torque sensor's."""

SENSOR_NOISE_RATIO = (1.3, 16.0)
"""Power of a recording's sensor noise over that of the repeats: less is chance, and more would be no noise."""

LEAST = 1e-24
"""Power that stands for none at all."""


@dataclass(frozen=True, eq=False)
class Rounding:
    """Rounding that the repeats do not show, simulated for one recording.

    Attributes:
        acceleration: (M, n) in the band [rad/s^2].
        velocity: (M, n) in the band [rad/s].
        snap: (M, n) second derivative of the acceleration in the band [rad/s^4].
        torque: (M, n) what the links would need for that acceleration [N.m].
        rotor: (M, n) what the rotors would [N.m].
    """

    acceleration: Array
    velocity: Array
    snap: Array
    torque: Array
    rotor: Array

    @property
    def power(self) -> Array:
        """(n,) of the accelerations' noise [rad^2/s^4]."""
        return np.asarray(np.mean(self.acceleration**2, axis=0))

    def of(self, group: Group) -> Array:
        """(M,) what it adds to a residual."""
        residual, joint = group
        if residual == "velocity":
            return np.asarray(-self.velocity[:, joint])
        drive = self.rotor[:, joint] if "actuator" in COVERS[residual] else 0.0
        links = self.torque[:, joint] if uses_motion(residual) else 0.0
        return np.asarray(-(links + drive) * np.ones(len(self.velocity)))


def unseen_rounding(item: Prepared, seen: Array) -> Rounding | None:
    """Gives the rounding that repeats lack; None where they show as much as there is.

    Args:
        item: One of the repeats.
        seen: (n,) power of the accelerations' noise that the repeats show [rad^2/s^4].
    """
    made = made_by_grid(item)
    if made is None:
        return None
    whole = made.power
    lacking = np.where(seen < LACKING * whole, 1.0 - seen / np.maximum(whole, 1e-300), 0.0)
    if not lacking.any():
        return None
    return _torques(
        item, *(np.sqrt(lacking) * part for part in (made.velocity, made.acceleration, made.snap))
    )


def read_noise(item: Prepared) -> Array:
    """Rms of white noise in a recording's positions, (n,) [rad per sample], by their spectrum beyond the motion."""
    return white_noise(item.log.position)


def white_noise(values: Array) -> Array:
    """Rms of white noise in readings (N, n), (n,), by the median of their spectrum beyond the motion."""
    frequency = np.fft.rfftfreq(len(values))
    beyond = periodogram(values)[(frequency > NOISE_ONLY[0]) & (frequency < NOISE_ONLY[1])]
    level = np.min([np.median(half, axis=0) for half in np.array_split(beyond, 2)], axis=0)
    return np.asarray(np.sqrt(level / np.log(2.0) / np.sum(np.hanning(len(values)) ** 2)))


def made_by_grid(item: Prepared) -> Rounding | None:
    """What the encoders' grids do to the residuals of a recording; None where there are no grids."""
    found = _grid_motion(item)
    return _torques(item, *found) if any(part.any() for part in found) else None


def made_by_positions(item: Prepared, seed: int) -> Rounding:
    """What errors of its positions do to the residuals of a recording: of each joint the grid's, or white noise.

    The size of the noise is read; it is the stronger one where positions cross many steps per sample.

    Args:
        item: The recording.
        seed: Of the white noise.
    """
    noise = read_noise(item) * np.random.default_rng(seed).standard_normal(item.log.position.shape)
    white, grid = _motion(item, noise), _grid_motion(item)
    stronger = np.mean(grid[1] ** 2, axis=0) > np.mean(white[1] ** 2, axis=0)
    return _torques(item, *(np.where(stronger, *both) for both in zip(grid, white, strict=True)))


def _grid_motion(item: Prepared) -> tuple[Array, Array, Array]:
    """As ``_motion``, of the errors that the encoders' grids make; zero where there are no grids."""
    errors = item.log.rounding
    return _motion(item, np.zeros_like(item.log.position) if errors is None else errors)


def _motion(item: Prepared, errors: Array) -> tuple[Array, Array, Array]:
    """Velocity, acceleration and its second derivative in the band, (M, n) each, that errors (N, n) of positions make.

    [rad/s], [rad/s^2] and [rad/s^4].
    """
    log = item.log
    time = np.arange(log.samples) / log.rate
    v = differentiate(item.band.smooth(errors), time)
    a = differentiate(v, time)
    snap = differentiate(differentiate(a, time), time)
    return item.band.condense(v), item.band.condense(a), item.band.condense(snap)


def position_powers(made: Sequence[Rounding], groups: Sequence[Group]) -> Array:
    """Mean squares of what the positions' noise makes of each recording's residuals, (recordings, groups)."""
    return np.array([[float(np.mean(one.of(group) ** 2)) for group in groups] for one in made])


def sensor_powers(prepared: Sequence[Prepared], groups: Sequence[Group]) -> Array:
    r"""Mean squares of what white noise of the torque sensors makes of the residuals, (recordings, groups).

    Zero without a sensor, and for one with a coarse grid. One that measures the springs' torques tells the rotors'
    motion, too: I_r c \ddot{n} + b c \dot{n} is added to its noise n in the residual of the actuators.
    """
    own = np.zeros((len(prepared), len(groups)))
    efforts = [item.log.effort for item in prepared]
    if any(effort is None for effort in efforts):
        return own
    sizes = _without_chance(np.array([white_noise(effort) for effort in efforts if effort is not None]))
    # A coarse reading of a slow torque stands still: what is read beyond the motion is not what rounding makes in it.
    steps = [item.log.effort_steps for item in prepared if item.log.effort_steps is not None]
    coarse = np.any([np.zeros(prepared[0].signals.n), *steps], axis=0)
    for r, item in enumerate(prepared):
        links, drives = (np.mean(part**2, axis=0) for part in _sensed_noise(item))
        for g, (residual, joint) in enumerate(groups):
            if EFFORT_SIGN[residual] and not coarse[joint]:
                own[r, g] = sizes[r, joint] ** 2 * (drives if residual == "actuator" else links)[joint]
    return own


def _without_chance(sizes: Array) -> Array:
    """Rms (recordings, n) of noise, those that differ from the usual one by no more than chance made equal to it."""
    usual = np.median(sizes, axis=0)
    ratio = (sizes / np.maximum(usual, 1e-300)) ** 2
    alike = (ratio < SENSOR_NOISE_RATIO[0]) & (ratio > 1.0 / SENSOR_NOISE_RATIO[0])
    return np.asarray(np.where(alike, usual, sizes))


def _sensed_noise(item: Prepared) -> tuple[Array, Array]:
    """White noise of unit size in the band, (M, n) each: alone, and with the rotors' motion that it pretends.

    The same draw for each recording: they differ by what their springs and filters make of it.
    """
    noise = np.random.default_rng(0).standard_normal((item.log.samples, item.signals.n))
    signals, time = item.signals, np.arange(item.log.samples) / item.log.rate
    smooth = item.band.smooth(noise)
    alone = item.band.condense(smooth)
    if not signals.measures_springs or not signals.spring_compliance.any():
        return alone, alone
    rate = differentiate(signals.spring_compliance * smooth, time)
    rotor = signals.reflected_inertia * differentiate(rate, time) + signals.motor_damping * rate
    return alone, alone + item.band.condense(rotor)


def noise_shares(power: Array, mean: Array, own: Array, louder: Array | float = 1.0) -> Array:
    r"""Says how much stronger the noise is in each recording than in the floor's own, (recordings, groups).

    M(q) of an outstretched arm makes more torque of the same noise of positions. The rest of the noise is alike, but
    for sensors that are noisier in one recording:

        k_r^2 = (c_r s + p_r) / (s + \bar{p}),      p the part that is read from each recording, s the rest

    Args:
        power: (groups,) of the floor's noise.
        mean: (groups,) of the part that is read, in the floor's recordings.
        own: (recordings, groups) of the part that is read: of positions, and white noise of the torque sensors.
        louder: (recordings, groups) power of the rest over that in the floor's recordings.
    """
    rest = np.maximum(power - mean, SENSOR_MIN * power) + LEAST
    return np.asarray(np.sqrt((louder * rest + own) / (rest + mean)))


def louder_sensors(
    groups: Sequence[Group], prepared: Sequence[Prepared], pairs: Sequence[tuple[int, int]]
) -> Array:
    """Power of the torque sensors' noise over that in the repeats, (recordings, groups); one without a sensor."""
    ratio = _sensor_noise_ratio(prepared, pairs)
    return np.array(
        [[row[joint] if EFFORT_SIGN[residual] else 1.0 for residual, joint in groups] for row in ratio]
    )


def acceleration_noise(one: Prepared, other: Prepared) -> Array:
    """Noise power of each joint's acceleration in the band, (n,)."""
    first, second = (item.band.condense(item.signals.acceleration) for item in (one, other))
    size = min(len(first), len(second))
    return np.asarray(np.mean((first[:size] - second[:size]) ** 2, axis=0) / 2.0)


def _torques(item: Prepared, speed: Array, acceleration: Array, snap: Array) -> Rounding:
    """What links and rotors would need; M(q) changes little while noise does."""
    mass, signals = mass_matrix(item.tree, item.position), item.signals
    curvature = np.einsum("mij,mj->mi", mass, snap)
    if not signals.measures_springs and signals.deflection_cutoffs is not None:
        # As far as the load that bends a spring is differentiated.
        curvature = low_passed(curvature, item.band.rate / item.band.step, signals.deflection_cutoffs)
    twist = 0.0 if signals.measures_springs else signals.spring_compliance * curvature
    links = acceleration - twist * signals.encoder_at_motor
    torque = np.einsum("mij,mj->mi", mass, links)
    turning = links + twist
    rotor = signals.reflected_inertia * turning
    return Rounding(acceleration, speed, snap, torque, rotor)


def _sensor_noise_ratio(prepared: Sequence[Prepared], pairs: Sequence[tuple[int, int]]) -> Array:
    """Power of each recording's sensor noise over that of the repeats, (recordings, n); one where it is about alike."""
    efforts = [item.log.effort for item in prepared]
    if any(effort is None for effort in efforts):
        return np.ones((len(prepared), prepared[0].signals.n))
    power = np.array([white_noise(effort) ** 2 for effort in efforts if effort is not None])
    repeated = np.mean([power[i] for pair in pairs for i in pair], axis=0)
    ratio = power / np.maximum(repeated, 1e-300)
    return np.where(ratio > SENSOR_NOISE_RATIO[0], np.minimum(ratio, SENSOR_NOISE_RATIO[1]), 1.0)
