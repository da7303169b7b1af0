# SPDX-License-Identifier: BSD-3-Clause
r"""One linearly implicit step of the arms, the object in their hands, and surfaces with friction.

From stiffness K and dampers D of springs and surfaces, the velocity v+ after the time s is, stable for any s,

    (M + s D + s^2 K) (v+ - v) = s (\tau - s K v) + contact,     A v+ = -(disagreement of the hands) / s

A point at depth d with normal n gets N = k d+ - c d'+, d+ = d - s n . J v+, never less than zero, and friction
-\mu N v_t / max(|v_t|, v_s): both are linear in v+ once N and |v_t| of the last step stand in.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.prediction.contact_geometry import Contact
from impedance_modules.prediction.hinge_resistance import HingeResistance
from impedance_modules.prediction.mechanism import Mechanism

NEAR = 0.02
"""Distance at which a point is watched [m]."""

REGULARISATION_VELOCITY = 2e-3
"""Regularisation velocity of friction v_s [m/s]: sticking points creep slower than this."""

TRIES = 3
"""Solutions per step while points that a surface would have to pull are left out."""


@dataclass(frozen=True)
class EquationOfMotion:
    """The equation of motion at one state, over k joints.

    Attributes:
        inertia, stiffness, dampers: (k, k) of arms, object and modules.
        force: (k,) on the joints now, without the surfaces [N.m].
        velocity: (k,) [rad/s].
    """

    inertia: Array
    stiffness: Array
    dampers: Array
    force: Array
    velocity: Array


class ImplicitStep:
    """Solves steps and keeps the normal force of every point, from which the next step's friction is.

    Attributes:
        friction_loss: Energy lost on surfaces in the last step [J].
        contacts_changed: Whether a point met or left a surface in the last step.
        hinge: What acts about the axis of the object's hinge; None without one.
        hinge_holds: Whether its friction or a stop held it at the end of the last step.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self._mechanism = mechanism
        self._normal_forces: dict[tuple[int, int, int], float] = {}
        self._before: dict[tuple[int, int, int], float] = {}
        self._step_of: Array = np.zeros(0)
        self.friction_loss = 0.0
        self.contacts_changed = self.hinge_holds = False
        held = mechanism.modules.held
        self.hinge = None if held is None or held.hinge is None else HingeResistance(held)

    def solve(self, now: EquationOfMotion, step: float) -> Array:
        """Gives the velocity (k,) [rad/s] at the end of an implicit Euler step [s].

        Called again at the same state it forgets the first answer.
        """
        v = now.velocity
        if v is self._step_of:
            self._normal_forces = self._before
        self._step_of, self._before = v, self._normal_forces
        system = now.inertia + step * now.dampers + step**2 * now.stiffness
        load = step * (now.force - step * now.stiffness @ v)
        rows, gap = self._mechanism.grasp_rows()
        points = [
            (contact, J)
            for contact, J in self._mechanism.contacts(NEAR)
            if contact.depth - step * float(contact.normal @ J @ v) > 0.0
        ]
        for _ in range(TRIES):
            new = self._velocity(system, load, rows=rows, gap=gap, points=points, v=v, step=step)
            forces = [self._normal_force(contact, J, new, step) for contact, J in points]
            kept = [point for point, force in zip(points, forces, strict=True) if force > 0.0]
            if len(kept) == len(points):
                break
            points = kept
        self._keep(points, new, step)
        self.contacts_changed = self._normal_forces.keys() != self._before.keys()
        return new

    def _velocity(
        self,
        system: Array,
        load: Array,
        *,
        rows: Array,
        gap: Array,
        points: list[tuple[Contact, Array]],
        v: Array,
        step: float,
    ) -> Array:
        k, held = len(v), len(rows)
        matrix, right = np.zeros((k + held, k + held)), np.zeros(k + held)
        matrix[:k, :k], right[:k] = system, load + system @ v
        # ``system`` acts on v+ - v; the surfaces' part acts on v+ itself.
        for contact, J in points:
            added, constant = self._linear(contact, J, v, step)
            matrix[:k, :k] += added
            right[:k] += constant
        matrix[:k, k:], matrix[k:, :k], right[k:] = rows.T, rows, -gap / step
        if self.hinge is not None:
            return self._on_hinge(self.hinge, matrix, right, step)
        return np.asarray(np.linalg.solve(matrix, right)[:k])

    def _on_hinge(self, hinge: HingeResistance, matrix: Array, right: Array, step: float) -> Array:
        """Solves with the hinge's own torque, which depends on the rate that it leaves."""
        angle, along = self._mechanism.hinge_motion()
        sides = np.column_stack([right, np.concatenate([step * along, np.zeros(len(right) - len(along))])])
        free, added = np.linalg.solve(matrix, sides)[: len(along)].T
        torque = hinge.solve(float(along @ free), float(along @ added), step)
        new = np.asarray(free + torque * added)
        self.hinge_holds = hinge.holds(angle + step * float(along @ new))
        return new

    def _linear(self, contact: Contact, J: Array, v: Array, step: float) -> tuple[Array, Array]:
        """Writes one point's force as (matrix on v+, constant), times the step."""
        surface = contact.surface
        into = contact.normal @ J
        rate = step * surface.stiffness + (surface.damping if contact.depth > 0.0 else 0.0)
        along = J - np.outer(contact.normal, into)
        speed = float(np.linalg.norm(along @ v))
        force = self._normal_forces.get(contact.key, max(0.0, surface.stiffness * contact.depth))
        friction = surface.fresh_friction * force / max(speed, REGULARISATION_VELOCITY)
        matrix = step * (rate * np.outer(into, into) + friction * along.T @ along)
        return matrix, step * surface.stiffness * contact.depth * into

    def _normal_force(self, contact: Contact, J: Array, new: Array, step: float) -> float:
        surface = contact.surface
        approach = -float(contact.normal @ J @ new)
        damped = surface.damping * approach if contact.depth > 0.0 else 0.0
        return surface.stiffness * (contact.depth + step * approach) + damped

    def _keep(self, points: list[tuple[Contact, Array]], new: Array, step: float) -> None:
        self.friction_loss = 0.0
        before, self._normal_forces = self._normal_forces, {}
        for contact, J in points:
            force = self._normal_force(contact, J, new, step)
            self._normal_forces[contact.key] = force
            along = J @ new - contact.normal * float(contact.normal @ J @ new)
            speed = float(np.linalg.norm(along))
            normal = before.get(contact.key, force)
            self.friction_loss += (
                step
                * contact.surface.fresh_friction
                * normal
                * speed
                * min(1.0, speed / REGULARISATION_VELOCITY)
            )
