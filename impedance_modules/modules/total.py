# SPDX-License-Identifier: BSD-3-Clause
r"""The sum of all modules at one state: torque, energy, and who contributed what.

    \tau = \sum_springs J^T (w - D V) + \sum_hybrid J^T F - K_j (q - q_0) - D_j v
           + \sum_hands J^T (squeeze + weight)

Nothing is inverted and nothing is projected: impedances add.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.modules.arms import ArmModule, TaskModules
from impedance_modules.modules.damping import Damping
from impedance_modules.modules.equilibrium import Equilibrium
from impedance_modules.modules.held_object import HeldObject
from impedance_modules.modules.spring import Spring
from impedance_modules.robot.kinematics import Kinematics

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Term:
    """What one part of one module contributes.

    Attributes:
        name: Of the module, e.g. ``<arm>.<spring>``.
        kind: ``spring``, ``force`` (hybrid axes), ``damping``, ``squeeze`` or ``weight``.
        effort: (n,) torque on all joints [N.m].
        energy: Stored in it [J]; 0 for what stores none.
        wrench: (6,) on ``frame``, world axes at its origin; None for joint springs and dampers.
        frame: Where the wrench acts; None for joint springs and dampers.
    """

    name: str
    kind: str
    effort: Array
    energy: float
    wrench: Array | None
    frame: str | None


@dataclass(frozen=True)
class Terms:
    """All contributions of a cycle.

    Attributes:
        parts: One per contribution.
        effort: (n,) their sum, the torque the modules desire [N.m].
        energy: U, stored in all springs [J]; forces, squeeze and weight are not in it.
    """

    parts: tuple[Term, ...]
    effort: Array
    energy: float


def desired_effort(  # noqa: PLR0917 - a state, a task and its dampers, each on its own
    modules: TaskModules,
    kinematics: Kinematics,
    targets: Equilibrium,
    q: Array,
    v: Array,
    damping: Damping,
) -> Terms:
    """Sums what every module asks for at one state.

    Args:
        modules: With the gains of the phase.
        kinematics: Updated at (q, v), holding ``modules.frames``.
        targets: Equilibria now.
        q: (n,) [rad].
        v: (n,) [rad/s].
        damping: Designed at the start of the phase.
    """
    parts: list[Term] = []
    for arm in modules.arms:
        for spring in arm.springs:
            parts.extend(_spring_terms(spring, kinematics, targets, v, damping))
        parts.extend(_bias_terms(arm, targets, q, v, damping))
    if modules.held is not None:
        parts.extend(_object_terms(modules.held, kinematics))
    effort = np.sum([part.effort for part in parts], axis=0) if parts else np.zeros(len(q))
    return Terms(tuple(parts), effort, float(sum(part.energy for part in parts)))


def _spring_terms(
    spring: Spring, kinematics: Kinematics, targets: Equilibrium, v: Array, damping: Damping
) -> Iterator[Term]:
    jacobian, pose = kinematics.jacobian_of(spring.frame), kinematics.pose(spring.frame)
    target = targets.springs[spring.name]

    def term(kind: str, wrench: Array, energy: float) -> Term:
        return Term(spring.name, kind, jacobian.T @ wrench, energy, wrench, spring.frame)

    yield term("spring", spring.wrench(pose, target), spring.energy(pose, target))
    yield term("damping", -damping.of_spring(spring) @ (jacobian @ v), 0.0)
    if spring.hybrid:
        yield term("force", spring.axis_force(), 0.0)


def _bias_terms(arm: ArmModule, targets: Equilibrium, q: Array, v: Array, damping: Damping) -> Iterator[Term]:
    bias = arm.bias
    if bias is None:
        return
    elastic, viscous = np.zeros_like(q), np.zeros_like(q)
    rest = targets.rests[bias.limb]
    elastic[bias.joints] = bias.effort(q, rest)
    viscous[bias.joints] = -damping.of_joints(bias.limb) @ v[bias.joints]
    yield Term(bias.name, "spring", elastic, bias.energy(q, rest), None, None)
    yield Term(bias.name, "damping", viscous, 0.0, None, None)


def _object_terms(held: HeldObject, kinematics: Kinematics) -> Iterator[Term]:
    # The grasps are rigid: where the hands are on the object is fixed in its axes, and measured noise stays out.
    R_WO = kinematics.pose(held.hands[0]).rotation @ held.grasps[0].rotation.T
    wrenches: list[tuple[str, Array]] = []
    if held.spec.squeeze > 0.0:
        wrenches.append(("squeeze", (held.squeeze.reshape(-1, 3) @ R_WO.T).reshape(-1, 6)))
    if held.spec.carry_weight:
        wrenches.append(("weight", held.weight(R_WO)))
    for kind, by_hand in wrenches:
        for limb, hand, wrench in zip(held.limbs, held.hands, by_hand, strict=True):
            effort = kinematics.jacobian_of(hand).T @ wrench
            yield Term(f"{limb}.{kind}", kind, effort, 0.0, wrench, hand)
