# SPDX-License-Identifier: BSD-3-Clause
"""Whether the sampled loop around elastic joints is stable, how its least damped mode decays, how stiff a hand may be.

Arms that hold one object together are one system, and so are arms that springs join; every other arm is its own. The
prediction is for motion without contact: surfaces are not in it, and neither are the arms' own gravity and its
compensation, which cancel.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.control.assembly import Assembly
from impedance_modules.modules.arms import TaskModules
from impedance_modules.superposition.arm_impedance import ArmImpedance
from impedance_modules.superposition.coupled_arms import CoupledArms
from impedance_modules.superposition.elastic_joints import (
    SampledArm,
    drives_of,
    sampled_arm,
    sampling_of,
)
from impedance_modules.superposition.modes import block_diagonal, least_damped
from impedance_modules.superposition.object_impedance import HeldImpedance
from impedance_modules.superposition.sampled_loop import (
    Gains,
    highest_stable_stiffness,
    oscillating_growth,
    sampled_modes,
    spectral_radius,
)

STIFFEST = 30.0
"""Times the task's own endpoint stiffness; beyond it nobody asks."""

ROUNDING = 1e-6
"""Of a growth per period."""


@dataclass(frozen=True)
class StabilityForecast:
    """The loop of one arm, or of the arms that hold the object.

    Attributes:
        name: Of the arm, ``object``, or the names of arms that springs join.
        growth: Spectral radius of one period; below 1 is stable.
        oscillating_growth: The same without motions that grow without swinging: an arm that folds, at any rate.
        frequency: Of the least damped mode [Hz]; None where nothing swings.
        damping_ratio: Of it; negative grows.
        scale: How far the endpoint stiffness can be raised before the loop is unstable, its damping growing as
            the root; None if it is stable up to ``STIFFEST``; 0 if it is unstable however soft.
        stiffness: The endpoint stiffness in its stiffest direction [N/m]; 0 without endpoint springs.
    """

    name: str
    growth: float
    oscillating_growth: float
    frequency: float | None
    damping_ratio: float | None
    scale: float | None
    stiffness: float

    @property
    def stable(self) -> bool:
        """Whether no oscillation grows; rounding of a free motion's double eigenvalue one is forgiven."""
        return self.oscillating_growth <= 1.0 + ROUNDING


@dataclass(frozen=True)
class _Loop:
    """One arm, or the arms that hold the object: plant, gains, and the hand's stiffness [N/m]."""

    name: str
    plant: SampledArm
    fixed: Gains
    scaled: Gains
    stiffness: float

    @property
    def gains(self) -> Gains:
        """All gains as they are now."""
        return Gains(self.fixed.stiffness + self.scaled.stiffness, self.fixed.damping + self.scaled.damping)


def forecast_stability(
    assembly: Assembly,
    modules: TaskModules,
    arms: Mapping[str, ArmImpedance],
    held: HeldImpedance | None,
    coupled: Sequence[CoupledArms] = (),
) -> tuple[StabilityForecast, ...]:
    """Predicts the loops of all arms with one phase's gains at one state; ``coupled`` arms make one loop together."""
    return tuple(_forecast(loop) for loop in _loops(assembly, modules, arms, held, coupled))


def loop_growths(
    assembly: Assembly,
    modules: TaskModules,
    arms: Mapping[str, ArmImpedance],
    held: HeldImpedance | None,
    coupled: Sequence[CoupledArms] = (),
) -> tuple[float, ...]:
    """Gives only the growth per period of each loop's fastest growing oscillation, in the same order."""
    loops = _loops(assembly, modules, arms, held, coupled)
    return tuple(oscillating_growth(loop.plant, loop.gains) for loop in loops)


def _loops(
    assembly: Assembly,
    modules: TaskModules,
    arms: Mapping[str, ArmImpedance],
    held: HeldImpedance | None,
    coupled: Sequence[CoupledArms],
) -> Iterator[_Loop]:
    grouped: tuple[str, ...] = ()
    if held is not None and modules.held is not None:
        grouped = modules.held.limbs
        yield _object_loop(assembly, modules, [arms[limb] for limb in grouped], held)
    for group in coupled:
        grouped = (*grouped, *group.limbs)
        yield _coupled_loop(assembly, modules, group)
    for arm in modules.arms:
        if arm.limb.name not in grouped:
            own = arms[arm.limb.name]
            plant = sampled_arm(
                own.system.inertia,
                drives_of(assembly.model, arm.limb.joints),
                sampling_of(assembly.robot, assembly.rate, True),
                None,
                None,
            )
            yield _Loop(arm.limb.name, plant, own.fixed, own.scaled, _stiffest(modules, arm.limb.name))


def _coupled_loop(assembly: Assembly, modules: TaskModules, group: CoupledArms) -> _Loop:
    joints = np.concatenate([modules.arm(limb).limb.joints for limb in group.limbs])
    plant = sampled_arm(
        group.system.inertia,
        drives_of(assembly.model, joints),
        sampling_of(assembly.robot, assembly.rate, True),
        None,
        None,
    )
    between = [
        float(np.linalg.eigvalsh(spring.spec.stiffness[:3, :3])[-1])
        for spring in modules.between
        if spring.limbs[0] in group.limbs
    ]
    stiffest = max([_stiffest(modules, limb) for limb in group.limbs] + between)
    return _Loop(group.name, plant, group.fixed, group.scaled, stiffest)


def _object_loop(
    assembly: Assembly, modules: TaskModules, holding: list[ArmImpedance], held: HeldImpedance
) -> _Loop:
    model = assembly.model
    joints = np.concatenate([modules.arm(arm.limb).limb.joints for arm in holding])
    own = modules.held
    inertia = np.zeros((6, 6)) if own is None else own.inertia(held.pose.rotation)
    twist = held.motion.twist
    plant = sampled_arm(
        block_diagonal([arm.system.inertia for arm in holding]),
        drives_of(model, joints),
        sampling_of(assembly.robot, assembly.rate, True),
        held.motion.motion,
        twist.T @ inertia @ twist,
    )
    stiffest = max(_stiffest(modules, arm.limb) for arm in holding)
    fixed, scaled = _stacked([arm.fixed for arm in holding]), _stacked([arm.scaled for arm in holding])
    if held.coupling is not None:
        joined = held.coupling
        fixed = Gains(fixed.stiffness + joined.joint_stiffness, fixed.damping + joined.joint_damping)
    return _Loop("object", plant, fixed, scaled, stiffest)


def _forecast(loop: _Loop) -> StabilityForecast:
    plant, now = loop.plant, loop.gains
    mode = least_damped([m for m in sampled_modes(plant, now) if m.frequency < math.pi * plant.sampling.rate])
    scale = None
    if loop.stiffness > 0.0:
        scale = highest_stable_stiffness(plant, loop.fixed, loop.scaled, STIFFEST)
    return StabilityForecast(
        name=loop.name,
        growth=spectral_radius(plant, now),
        oscillating_growth=oscillating_growth(plant, now),
        frequency=None if mode is None else mode.frequency / (2.0 * math.pi),
        damping_ratio=None if mode is None else mode.damping_ratio,
        scale=scale,
        stiffness=loop.stiffness,
    )


def _stacked(gains: list[Gains]) -> Gains:
    """Puts the gains of several arms side by side."""
    stiffness = block_diagonal([arm.stiffness for arm in gains])
    return Gains(stiffness, block_diagonal([arm.damping for arm in gains]))


def _stiffest(modules: TaskModules, limb: str) -> float:
    """Gives the largest translational stiffness of the springs on an arm's hand [N/m]."""
    total = np.sum([np.zeros((3, 3)), *_linear_blocks(modules, limb)], axis=0)
    return float(np.linalg.eigvalsh(total)[-1])


def _linear_blocks(modules: TaskModules, limb: str) -> Iterator[Array]:
    arm = modules.arm(limb)
    for spring in arm.springs:
        if spring.frame == arm.limb.hand:
            yield spring.in_world(spring.stiffness)[:3, :3]
