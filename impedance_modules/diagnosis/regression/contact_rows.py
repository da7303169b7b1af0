# SPDX-License-Identifier: BSD-3-Clause
r"""Samples in contact with surfaces that the task knows, and their noise, errors in variables included.

A hand at depth d below a surface of stiffness k consumes

    r = -J^T (N n + f),      N = \max(0, k d + c v_n),      f = -\mu N v_t / |v_t|

Stiff surfaces turn errors of positions into torques: 0.1 mm on 20 kN/m are 2 N. So the noise of a sample is not
that of its torques alone, but for all joints together

    \Sigma = diag(\sigma_\tau^2) + a a^T (k^2 \sigma_d^2 + c^2 \sigma_v^2) + (\mu N)^2 s J_t^T J_t,
    a = -J^T (n + f / N),      \sigma_d^2 = \sum_j (n . J_j)^2 \sigma_{q,j}^2

\sigma_d the depth's noise by the encoders', \sigma_v the closing speed's. The last part stands for a hand that hardly
slides: its friction is anywhere within the cone, s = 1 - tanh^2(|v_t| / v_0).

What does not change in time is a nuisance with a prior instead: zeros of the joints' encoders shift the depth by
n . J \delta q_0, and links weigh \pm 3 % more or less.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.regression.nuisance_columns import inertia_prior
from impedance_modules.diagnosis.regression.sensor_noise import made_by_positions, read_noise, white_noise
from impedance_modules.diagnosis.residuals.contact_mask import MARGIN, near_contact
from impedance_modules.diagnosis.residuals.preparation import Prepared
from impedance_modules.effects.joint_motion import SLIDING_REGULARISATION_VELOCITY
from impedance_modules.effects.recorded_signals import differentiate
from impedance_modules.effects.residual_kinds import Residual
from impedance_modules.effects.surface_effects import FLAT_KINDS, SurfaceTouch, touches
from impedance_modules.spec.task import SurfaceSpec

Mask = NDArray[np.bool_]

ZERO_PRIOR = 5e-4
"""Standard deviation of a joint's zero [rad] or [m]: a hand a metre away is known to about a millimetre."""


@dataclass(frozen=True)
class SurfaceNumbers:
    """A surface as it may be: how much higher it lies [m], its stiffness [N/m], its friction [-]."""

    dh: float
    k: float
    mu: float

    @classmethod
    def of(cls, surface: SurfaceSpec) -> SurfaceNumbers:
        """As the task has it."""
        return cls(0.0, surface.stiffness, surface.friction)


@dataclass(frozen=True, eq=False)
class HandContact:
    """One hand over one surface of the task; ``surface`` counts the task's surfaces."""

    surface: int
    nominal: SurfaceSpec
    touch: SurfaceTouch

    def pressure(self, numbers: SurfaceNumbers) -> Array:
        """N (N,) [N]."""
        return self.touch.pressure(replace(self.nominal, stiffness=numbers.k), numbers.dh)

    def direction(self, numbers: SurfaceNumbers) -> Array:
        """Torque (N, n) consumed per newton of pressure, friction included [m]."""
        speed = np.linalg.norm(self.touch.sliding, axis=1)
        share = np.tanh(speed / SLIDING_REGULARISATION_VELOCITY) / np.maximum(speed, 1e-12)
        drag = -(numbers.mu * share)[:, None] * self.touch.sliding
        return self.touch.consumed(self.touch.normal + drag)


@dataclass(frozen=True, eq=False)
class ContactRecording:
    """One recording whose task knows the surfaces.

    Attributes:
        item: The recording.
        residual: Which compares torque and the links' motion.
        contacts: Hands over surfaces.
        target: (M, n) residual, less what named causes explain [N.m].
        nuisance: (M, n, 10 n) columns of the links' inertial parameters, in deviations of their prior.
        touching, free: (M,) rows in contact, and rows away from any; those between belong to neither.
        torque_noise: (n,) rms of the residual's noise in the band [N.m].
        zero_noise: (n,) rms of the positions' noise in the band [rad].
        speed_noise: (n,) likewise of the velocities' [rad/s].
    """

    item: Prepared
    residual: Residual
    contacts: tuple[HandContact, ...]
    target: Array
    nuisance: Array
    touching: Mask
    free: Mask
    torque_noise: Array
    zero_noise: Array
    speed_noise: Array

    def torque(self, numbers: Mapping[int, SurfaceNumbers]) -> Array:
        """Torque (M, n) that the contacts consume [N.m]."""
        total = np.zeros((self.item.signals.samples, self.item.signals.n))
        for contact in self.contacts:
            own = numbers[contact.surface]
            total += contact.pressure(own)[:, None] * contact.direction(own)
        return self.item.band.condense(total)

    def zero_columns(self, numbers: Mapping[int, SurfaceNumbers]) -> Array:
        """Change of that torque (M, n, n) per deviation of each joint's zero."""
        n = self.item.signals.n
        total = np.zeros((self.item.signals.samples, n, n))
        for contact in self.contacts:
            own = numbers[contact.surface]
            stiff = own.k * (contact.pressure(own) > 0.0)
            deeper = -np.einsum("k,ikj->ij", contact.touch.normal, contact.touch.jacobian)
            total += (stiff[:, None] * contact.direction(own))[:, :, None] * deeper[:, None, :]
        return self.item.band.condense(total) * ZERO_PRIOR

    def covariance(self, numbers: Mapping[int, SurfaceNumbers]) -> Array:
        """Noise (M, n, n) of each row [N^2.m^2]."""
        band = self.item.band
        total = np.tile(np.diag(self.torque_noise**2), (self.item.samples, 1, 1))
        for contact in self.contacts:
            own = numbers[contact.surface]
            pressure = np.clip(band.condense(contact.pressure(own)), 0.0, None)
            normal = np.einsum("k,ikj->ij", contact.touch.normal, band.pick(contact.touch.jacobian))
            depth = np.sqrt((normal**2) @ self.zero_noise**2)
            closing = np.sqrt((normal**2) @ self.speed_noise**2)
            size = (own.k * depth) ** 2 + (contact.nominal.damping * closing) ** 2
            along = band.pick(contact.direction(own)) * np.sqrt(size * (pressure > 0.0))[:, None]
            total += along[:, :, None] * along[:, None, :]
            across = band.pick(contact.touch.jacobian) - contact.touch.normal[:, None] * normal[:, None, :]
            slow = self._sticking(contact) * (own.mu * pressure) ** 2
            total += slow[:, None, None] * np.einsum("ikj,ikl->ijl", across, across)
        return total

    def _sticking(self, contact: HandContact) -> Array:
        """How far (M,) a hand is from sliding for certain, 1 where it rests."""
        sliding = self.item.band.pick(np.linalg.norm(contact.touch.sliding, axis=1))
        J = self.item.band.pick(contact.touch.jacobian)
        noise = np.sqrt(np.einsum("ikj,j->i", J**2, self.speed_noise**2))
        return np.asarray(1.0 - np.tanh(sliding / (SLIDING_REGULARISATION_VELOCITY + 3.0 * noise)) ** 2)


def contact_recording(
    item: Prepared,
    surfaces: Sequence[SurfaceSpec],
    hands: Sequence[str],
    explained: Array,
    residual: Residual,
) -> ContactRecording | None:
    """Takes the rows of a recording that are in contact with planes and boxes.

    Args:
        item: The recording.
        surfaces: Of its task, with known effects applied.
        hands: That touch them.
        explained: (M, n) what named causes add to the residual [N.m].
        residual: Which compares torque and the links' motion.

    Returns:
        None if it is never in contact, or none of its hands can be.
    """
    known = item.signals.model.bodies
    signals = replace(item.signals, hands=tuple(hand for hand in hands if hand in known))
    contacts = tuple(
        HandContact(index, surface, touch)
        for index, surface in enumerate(surfaces)
        if surface.surface in FLAT_KINDS and surface.wood is None
        for touch in touches(signals, surface)
        if touch.jacobian.any() and np.isfinite(touch.depth).any()
    )
    touching, free = _rows(item)
    if not contacts or not touching.any():
        return None
    prior = inertia_prior(item.tree.inertia)
    return ContactRecording(
        item=item,
        residual=residual,
        contacts=contacts,
        target=item.residuals[residual] - explained,
        nuisance=item.link_nuisance * prior,
        touching=touching,
        free=free,
        torque_noise=_torque_noise(item, residual),
        zero_noise=position_noise(item, rate=False),
        speed_noise=position_noise(item, rate=True),
    )


def _rows(item: Prepared) -> tuple[Mask, Mask]:
    """Rows (M,) that are in contact for longer than the margin about them, and rows with none within it."""
    log = item.log
    if log.in_contact is None:
        return np.zeros(item.samples, dtype=bool), np.ones(item.samples, dtype=bool)
    outside = replace(item, log=replace(log, in_contact=~log.in_contact))
    return ~near_contact(outside, MARGIN), ~near_contact(item, MARGIN)


def _torque_noise(item: Prepared, residual: Residual) -> Array:
    """Rms (n,) that noise of positions and torques makes of a residual in the band."""
    made = made_by_positions(item, 0)
    moved = np.array([np.mean(made.of((residual, joint)) ** 2) for joint in range(item.signals.n)])
    log = item.log
    read = log.effort if residual != "whole" else log.command
    in_band = 2.0 * item.band.cutoff / item.band.rate
    return np.asarray(np.sqrt(moved + in_band * (0.0 if read is None else white_noise(read)) ** 2 + 1e-12))


def position_noise(item: Prepared, *, rate: bool) -> Array:
    """Rms (n,) of positions' noise in the band, or of that of their rate: of the grids, or white, the stronger."""
    log = item.log
    white = read_noise(item) * np.random.default_rng(0).standard_normal(log.position.shape)
    found = []
    for errors in (white, log.rounding):
        if errors is None:
            continue
        smooth = item.band.smooth(errors)
        if rate:
            smooth = differentiate(smooth, np.arange(log.samples) / log.rate)
        found.append(np.mean(item.band.condense(smooth) ** 2, axis=0))
    return np.asarray(np.sqrt(np.max(found, axis=0)))
