# SPDX-License-Identifier: BSD-3-Clause
"""Which causes a plant can wear in a rollout, and the plant that wears them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.result import Cause
from impedance_modules.diagnosis.rollout.nuisance import Nuisance, body_changes
from impedance_modules.diagnosis.rollout.outcome import LeftOut
from impedance_modules.diagnosis.rollout.robot import RATE
from impedance_modules.diagnosis.tree import RigidTree
from impedance_modules.effects.catalogue import CATALOGUE
from impedance_modules.effects.description import Port
from impedance_modules.effects.residuals import Residual
from impedance_modules.effects.wear import wear_patch, wear_plant
from impedance_modules.effects.worn import WornPlant
from impedance_modules.errors import BadInput
from impedance_modules.plant.plant import PlantOptions
from impedance_modules.plant.rollout_plant import RolloutPlant
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.patch import EffectSpec, PatchSpec, Quantity
from impedance_modules.spec.robot import RobotSpec
from impedance_modules.spec.source import parse_document

Array = NDArray[np.float64]

DOWNSTREAM: dict[str, tuple[Residual, ...]] = {
    "command": ("actuator", "link", "motor", "whole", "drive"),
    "motor": ("motor",),
    "effort": ("link",),
}
"""Driving torque -> residuals of what lies behind it: an effect that shows in none cannot move the rollout."""

STEPS = (1e-3, 0.5e-3, 0.25e-3, 0.125e-3)
"""Integration steps [s], the longest that is stable is taken."""

BOUND_TO_A_RECORDING = ("external_contact",)
"""Effects in the time of one recording: they say nothing about another."""


@dataclass(frozen=True, eq=False)
class Dressed:
    """A plant, with what it wears and the map of joints.

    Attributes:
        plant: Reset once, ready to be seeded.
        worn: What it wears.
        order: Index into the plant's joints of each of the diagnosis's.
        nuisance: Changes beside the causes.
    """

    plant: RolloutPlant
    worn: WornPlant
    order: tuple[int, ...]
    nuisance: Nuisance

    def lightness(self, position: Array) -> Array:
        """Squared entries (n, n) of the inverse mass matrix at a position, both in the diagnosis's joint order."""
        ours, theirs = np.array(self.order), np.argsort(self.order)
        inverse = np.linalg.inv(self.plant.model.mass_matrix(position[theirs]))
        return np.asarray(inverse[np.ix_(ours, ours)] ** 2)


def spec_of_cause(cause: Cause) -> EffectSpec:
    """Writes a cause as an entry of a patch."""
    parameters = {
        key: {symbol: Quantity(e.value, e.unit, None) for symbol, e in symbols.items()}
        for key, symbols in cause.parameters.items()
    }
    return EffectSpec(cause.effect, cause.joints, cause.port, parameters, {})


def wearable(effects: Sequence[EffectSpec], drive: str) -> tuple[tuple[EffectSpec, ...], tuple[LeftOut, ...]]:
    """Separates the effects that a rollout by one kind of torque can show from the others."""
    kept, dropped = [], []
    for spec in effects:
        effect = CATALOGUE[spec.effect]
        port: Port = next(port for port in effect.description.ports if port == spec.port)
        name = f"{spec.effect} on {', '.join(spec.parameters)}"
        if spec.effect in BOUND_TO_A_RECORDING:
            dropped.append(LeftOut(name, "it belongs to the time of one recording"))
        elif not any(effect.shows(port, residual) for residual in DOWNSTREAM[drive]):
            dropped.append(LeftOut(name, f"it does not lie between the recorded {drive} and the motion"))
        else:
            kept.append(spec)
    return tuple(kept), tuple(dropped)


def dress(robot: RobotSpec, effects: Sequence[EffectSpec], nuisance: Nuisance, tree: RigidTree) -> Dressed:
    """Builds the plant of a robot that wears effects, its links adjusted.

    Raises:
        BadInput: The robot cannot wear them, with the reason.
    """
    patch = PatchSpec(robot.name, tuple(effects), parse_document(Path("the causes"), "format: 1\n"))
    changed = replace(robot, body_changes=body_changes(tree.bodies, nuisance.links))
    model = RobotModel(wear_patch(changed, patch) if effects else changed)
    worn = wear_plant(model, patch)
    for step in STEPS:
        plant = RolloutPlant(model, [], None, PlantOptions(RATE, seed=0, noise=False, step=step), worn)
        try:
            plant.reset(np.zeros(model.n))
        except BadInput:
            if step == STEPS[-1]:
                raise
            continue
        break
    return Dressed(plant, worn, tuple(model.joint_names.index(name) for name in tree.joints), nuisance)
