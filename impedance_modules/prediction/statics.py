# SPDX-License-Identifier: BSD-3-Clause
r"""Where a task comes to rest: springs, forces, weights and surfaces in balance, without friction on surfaces.

    \tau_modules(q) + J_O^T m g + \sum J_p^T n k d(q) + J_\phi^T \tau_\phi + A^T \lambda = 0,        every grasp kept

\tau_\phi is what a hinge of the object exerts about its axis, its friction included where it is known what it holds.

Away from rest the arm is followed as if it crept there, its inertia taken for damping and nothing thrown about:

    (H + r M) \Delta q = \tau(q),        H = K_j - \Gamma + J^T K J + surfaces + the object's turning loads

which is an implicit Euler step of M dq/ds = \tau of length 1 / r. H is the analysis's own stiffness in joint space.
As the motion dies away the steps grow, r goes to 0 and what is left is Newton's method, which ends at rest to rounding
(pseudo-transient continuation, Kelley and Keyes 1998). A step need not make the torque that is left smaller: where an
arm moves on a stiff surface against joint springs that are a million times softer, the way to rest is a narrow curved
valley of the energy, each step along it presses the hand a little into the surface, and the next one brings it back.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.modules.held_object import OBJECT
from impedance_modules.prediction.contact_geometry import Contact
from impedance_modules.prediction.hinge_resistance import AxisLoad, HingeResistance
from impedance_modules.prediction.mechanism import Mechanism, Setting
from impedance_modules.superposition.arm_impedance import ArmImpedance, arm_impedance
from impedance_modules.superposition.coupled_arms import (
    CoupledArms,
    JointCoupling,
    across,
    couple_arms,
    joint_coupling,
)
from impedance_modules.superposition.object_impedance import (
    HeldImpedance,
    bearing_turns,
    held_impedance,
    lever_arm_stiffness,
)

BALANCED = 1e-9
"""Largest joint torque left over at rest [N.m]."""

CLOSED = 1e-11
"""Largest disagreement of the hands on the object's pose at rest [m, rad]."""

STEPS = 200
"""Of a search, steps that were too long included."""

NEAR = 0.02
"""Distance from a surface at which a step reckons with a point [m]."""

GRASPED = 1e-9
"""A motion of the joints that changes a grasp by less per rad keeps it [m, rad]."""

SWITCHES = 10
"""Solutions per step while points that the step itself brings in or takes out are added or let go."""

LONGEST_STEP = 0.1
"""Of any joint in one step [rad]."""

SHORTER, LONGER = 4.0, 3.0
"""Factors of r after a step that would have been too long, and of the step's length 1 / r after any other."""

SHORTEST = 1e-6
"""Least 1 / r: a step that is still too long then closes the grasps, and is cut [s^2]."""


@dataclass(frozen=True)
class Rest:
    """A static equilibrium.

    Attributes:
        q: (n,) [rad].
        effort: (n,) torque that the modules command [N.m].
        pressure: Hand frame or ``object`` -> (6,) of the surfaces on it, at its origin, world axes [N, N.m].
        slides_off: Whether a round surface falls away faster than the springs hold: without friction the least push
            would end it.
    """

    q: Array
    effort: Array
    pressure: Mapping[str, Array]
    slides_off: bool = False


@dataclass(frozen=True)
class Loads:
    """What acts besides modules and weights.

    Attributes:
        pushes: Hand frame or ``object`` -> (6,) constant wrench at its origin, world axes [N, N.m].
        surfaces: Whether the task's surfaces are there.
    """

    pushes: Mapping[str, Array]
    surfaces: bool


SURROUNDINGS = Loads({}, True)
"""The task's own surfaces and nothing else."""


@dataclass(frozen=True)
class Analysed:
    """Arms and object at one state.

    Attributes:
        arms: Limb name -> arm; what springs between arms do to it counts while the other arms are held still.
        held: The object; None for none.
        coupling: Springs between arms; None without any.
        coupled: Arms that these join and no object does.
    """

    arms: Mapping[str, ArmImpedance]
    held: HeldImpedance | None
    coupling: JointCoupling | None = None
    coupled: tuple[CoupledArms, ...] = ()


def analyse_state(mechanism: Mechanism, setting: Setting, q: Array, *, at_rest: bool = True) -> Analysed:
    """Analyses every arm, and the object in their hands, at q (n,) [rad]: at rest, or on the way."""
    mechanism.update(q, np.zeros_like(q))
    kinematics = mechanism.kinematics
    modules, targets = setting.modules, setting.targets
    coupling = joint_coupling(modules, kinematics, targets, setting.damping)
    arms = {
        arm.limb.name: arm_impedance(
            arm,
            kinematics,
            targets,
            q,
            setting.damping,
            at_rest=at_rest,
            beside=None if coupling is None else coupling.on(arm.limb.joints),
        )
        for arm in modules.arms
    }
    limbs = {arm.limb.name: arm.limb for arm in modules.arms}
    holding = () if modules.held is None else modules.held.limbs
    groups = () if coupling is None else coupling.groups
    joins = coupling is not None and any(set(group) <= set(holding) for group in groups)
    between = (coupling, [limbs[name] for name in holding]) if coupling is not None and joins else None
    return Analysed(
        arms=arms,
        held=None if modules.held is None else held_impedance(modules.held, arms, between),
        coupling=coupling,
        coupled=tuple(
            couple_arms(coupling, [limbs[name] for name in group], arms)
            for group in groups
            if coupling is not None and not set(group) <= set(holding)
        ),
    )


def find_rest(
    mechanism: Mechanism, setting: Setting, start: Array, loads: Loads = SURROUNDINGS
) -> Rest | None:
    """Finds the static equilibrium near a posture.

    Args:
        mechanism: Of the task.
        setting: Springs and equilibria; dampers do not matter at rest.
        start: (n,) [rad].
        loads: Besides modules and weights.

    Returns:
        The equilibrium, or None where the search does not converge.
    """
    balance, q, length = _Balance(mechanism, setting, loads), start.copy(), 1.0
    balance.move_to(q)
    for _ in range(STEPS):
        if balance.converged:
            return Rest(q, balance.effort, balance.pressure(), balance.slides_off)
        step = balance.step(length)
        longest = float(np.max(np.abs(step)))
        if longest > LONGEST_STEP and length > SHORTEST:
            length /= SHORTER
            continue
        q[mechanism.joints] += step * min(1.0, LONGEST_STEP / max(longest, LONGEST_STEP))
        balance.move_to(q)
        length *= LONGER
    return None


class _Balance:
    """Forces and their derivative at the last posture."""

    def __init__(self, mechanism: Mechanism, setting: Setting, loads: Loads) -> None:
        self._mechanism, self._setting, self._loads = mechanism, setting, loads
        self._force, self._left = np.zeros(mechanism.k), np.zeros(mechanism.k)
        self._rows, self._gap = np.zeros((0, mechanism.k)), np.zeros(0)
        held = setting.modules.held
        self._hinge = None if held is None or held.hinge is None else HingeResistance(held)
        self._axis: tuple[Array, AxisLoad] | None = None
        self._near: list[tuple[Contact, Array]] = []
        self._hessian = np.zeros((mechanism.k, mechanism.k))
        self.effort: Array = np.zeros(mechanism.model.n)

    def move_to(self, q: Array) -> None:
        """Finds forces and their derivative at q (n,) [rad]."""
        mechanism, setting = self._mechanism, self._setting
        still = np.zeros_like(q)
        mechanism.update(q, still)
        self.effort, _ = mechanism.module_efforts(setting, q, still)
        force = self.effort[mechanism.joints] + mechanism.object_load()
        for frame, wrench in self._loads.pushes.items():
            force = force + self._body(frame).T @ wrench
        if self._hinge is not None:
            angle, along = mechanism.hinge_motion()
            self._axis = along, self._hinge.at_rest(angle, setting.friction_rest)
            force = force + self._axis[1].torque * along
        self._near = mechanism.contacts(NEAR) if self._loads.surfaces else []
        self._rows, self._gap = mechanism.grasp_rows()
        self._force = force
        for contact, J in self._touching:
            force = force + J.T @ (contact.surface.stiffness * contact.depth * contact.normal)
        self._left = _unsupported(force, self._rows)
        self._hessian = self._derivative(q)

    @property
    def converged(self) -> bool:
        """Whether the last posture is at rest."""
        closed = not self._gap.size or float(np.max(np.abs(self._gap))) < CLOSED
        return closed and float(np.max(np.abs(self._left))) < BALANCED

    @property
    def _touching(self) -> list[tuple[Contact, Array]]:
        return [(contact, J) for contact, J in self._near if contact.depth > 0.0]

    def step(self, length: float) -> Array:
        """Gives the implicit step (k,) [rad] of a length 1 / r [s^2] from the last posture.

        Depths change in proportion to the step, and just those points press that are inside after it.
        """
        matrix = self._hessian + (1.0 / length + 1e-8) * self._mechanism.inertia()
        points = self._touching
        for _ in range(SWITCHES):
            found = self._solve(matrix, points)
            inside = [(c, J) for c, J in self._near if c.depth - float(c.normal @ J @ found) > 0.0]
            if [c.key for c, _ in inside] == [c.key for c, _ in points]:
                break
            points = inside
        return found

    def _solve(self, hessian: Array, points: list[tuple[Contact, Array]]) -> Array:
        """Solves for one set of points that press; ``hessian`` and the force are without them."""
        k, held = len(hessian), len(self._rows)
        matrix, right = np.zeros((k + held, k + held)), np.concatenate([self._force, -self._gap])
        matrix[:k, :k], matrix[:k, k:], matrix[k:, :k] = hessian, self._rows.T, self._rows
        for contact, J in points:
            into = contact.normal @ J
            matrix[:k, :k] += contact.surface.stiffness * np.outer(into, into)
            right[:k] += contact.surface.stiffness * contact.depth * into
        return np.asarray(np.linalg.solve(matrix, right)[:k])

    def pressure(self) -> Mapping[str, Array]:
        """Sums the surfaces' forces on every body."""
        hands = [arm.limb.hand for arm in self._setting.modules.arms]
        names = [*hands, OBJECT]
        found = {
            name: np.zeros(6) for name in names if name != OBJECT or self._setting.modules.held is not None
        }
        for contact, _ in self._touching:
            force = contact.surface.stiffness * contact.depth * contact.normal
            found[names[contact.key[0]]] += np.concatenate([force, np.cross(contact.arm, force)])
        return found

    @property
    def slides_off(self) -> bool:
        """Whether the turning normals of round surfaces take all stiffness from some motion of the joints."""
        if not self._turns:
            return False
        pressed = self._hessian.copy()
        for contact, J in self._touching:
            into = contact.normal @ J
            pressed += contact.surface.stiffness * np.outer(into, into)
        _, sizes, right = np.linalg.svd(self._rows)
        free = right[np.count_nonzero(sizes > GRASPED) :].T
        without = pressed + self._turning_normals()
        least, before = (np.linalg.eigvalsh(free.T @ matrix @ free)[0] for matrix in (pressed, without))
        return bool(least < 0.0 <= before)

    @property
    def _turns(self) -> bool:
        return any(contact.turning is not None for contact, _ in self._touching)

    def _turning_normals(self) -> Array:
        """Gives how the force on the joints changes because round surfaces' normals turn, N J^T dn/dx J (k, k)."""
        found = np.zeros_like(self._hessian)
        for contact, J in self._touching:
            if contact.turning is not None:
                push = contact.surface.stiffness * contact.depth
                found += push * J.T @ (0.5 * (contact.turning + contact.turning.T)) @ J
        return found

    def _body(self, frame: str) -> Array:
        return self._mechanism.object_jacobian() if frame == OBJECT else self._mechanism.jacobian(frame)

    def _derivative(self, q: Array) -> Array:
        """Gives minus the derivative of the force by the joints, (k, k), loads that turn included.

        Without what pressing deeper adds, which ``step`` puts in.
        """
        mechanism = self._mechanism
        state = analyse_state(mechanism, self._setting, q)
        found = np.zeros((mechanism.k, mechanism.k))
        for limb, arm in state.arms.items():
            part = mechanism.parts[limb]
            found[part, part] = arm.system.stiffness
        if state.coupling is not None:
            parts = [arm.limb.joints for arm in self._setting.modules.arms]
            found += across(state.coupling.stiffness, parts)
        if self._turns:
            found -= self._turning_normals()
        turning = np.zeros((6, 6))
        if state.held is not None:
            for hand in state.held.hands:
                turning = turning + lever_arm_stiffness(-hand.wrench[:3], hand.offset)
            if self._setting.modules.held is not None:
                held = state.held
                turning = turning + bearing_turns(
                    self._setting.modules.held, held.impedance.wrench, held.pose.translation
                )
        for contact, _ in self._touching:
            force = contact.surface.stiffness * contact.depth * contact.normal
            if contact.key[0] == len(self._setting.modules.arms):
                turning = turning + lever_arm_stiffness(-force, contact.arm)
        if state.held is not None:
            J = mechanism.object_jacobian()
            found += J.T @ turning @ J
        if self._axis is not None:
            along, load = self._axis
            found += load.stiffness * np.outer(along, along)
        return found


def _unsupported(force: Array, rows: Array) -> Array:
    """Leaves of a joint force (k,) what the grasps' own forces A^T lambda cannot balance."""
    if not len(rows):
        return force
    carried, *_ = np.linalg.lstsq(rows.T, force, rcond=None)
    return np.asarray(force - rows.T @ carried)
