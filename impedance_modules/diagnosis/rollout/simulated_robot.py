# SPDX-License-Identifier: BSD-3-Clause
r"""The simulated robot of a rollout: the nominal model with causes and the fitted nuisance applied.

It has the recorded joints only, no hands and no stops. The nuisance is what the fit adjusted within its priors beside
the causes: with \delta the fitted change of the bodies' ten parameters,

    links    ID = Y (\pi + \delta_l)        weight that the robot adds = W (\pi - \delta_w)
    delay    the command acts \delta_t later than in the nominal model
"""

from __future__ import annotations

import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.data.nominal_model import NominalModel
from impedance_modules.diagnosis.data.rigid_tree import Body, RigidTree, pseudo_inertia
from impedance_modules.diagnosis.model_selection.evidence import Evidence
from impedance_modules.diagnosis.regression.nuisance_columns import (
    INERTIA_PRIOR,
    TIMING_PRIOR,
    WEIGHT_PRIOR,
    inertia_prior,
)
from impedance_modules.diagnosis.result import Cause
from impedance_modules.diagnosis.rollout.patch_entry import patch_entry
from impedance_modules.diagnosis.rollout_result import LeftOut
from impedance_modules.effects.apply import apply_patch, apply_to_plant
from impedance_modules.effects.catalogue import CATALOGUE
from impedance_modules.effects.effect_description import Port
from impedance_modules.effects.plant_builder import PlantEffects
from impedance_modules.effects.residual_kinds import Residual
from impedance_modules.errors import BadInput
from impedance_modules.plant.plant import PlantOptions
from impedance_modules.plant.rollout_plant import RolloutPlant
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.document import parse_document
from impedance_modules.spec.patch_file import EffectSpec, PatchQuantity, PatchSpec
from impedance_modules.spec.robot_spec import (
    BodyChange,
    CollisionSpec,
    ContactDetectionSpec,
    JointSpec,
    RobotSpec,
    SensorSpec,
    TimingSpec,
)
from impedance_modules.spec.urdf import read_urdf

DOWNSTREAM: dict[str, tuple[Residual, ...]] = {
    "command": ("actuator", "link", "motor", "whole", "drive"),
    "motor": ("motor",),
    "effort": ("link",),
}
"""Driving torque -> residuals behind it: an effect that shows in none of them cannot change the rollout."""

STEPS = (1e-3, 0.5e-3, 0.25e-3, 0.125e-3)
"""Integration steps [s]; the longest stable one is taken."""

HALVINGS = 6
"""How often a body's change is halved until the result is physical."""

FAR = 1e6
"""A limit that no rollout reaches: a window starts where the robot was."""

RATE = 1000.0
"""Of the robot's own loop [Hz]; the rollouts need no other."""


@dataclass(frozen=True, eq=False)
class PerturbedPlant:
    """A plant with effects applied, and its joint order.

    Attributes:
        plant: Reset once, ready for an initial state.
        applied: The applied effects.
        order: Index in the plant's joints of each joint of the diagnosis.
        nuisance: Fitted changes beside the causes.
    """

    plant: RolloutPlant
    applied: PlantEffects
    order: tuple[int, ...]
    nuisance: FittedNuisance

    def squared_mobility(self, position: Array) -> Array:
        """Squared entries (n, n) of the inverse mass matrix at a position, both in the diagnosis's joint order."""
        ours, theirs = np.array(self.order), np.argsort(self.order)
        inverse = np.linalg.inv(self.plant.model.mass_matrix(position[theirs]))
        return np.asarray(inverse[np.ix_(ours, ours)] ** 2)


def apply_causes(
    robot: RobotSpec, effects: Sequence[EffectSpec], nuisance: FittedNuisance, tree: RigidTree
) -> PerturbedPlant:
    """Builds the plant of a robot with effects applied and its links adjusted.

    Raises:
        BadInput: The effects cannot be applied to the robot, with the reason.
    """
    patch = PatchSpec(robot.name, tuple(effects), parse_document(Path("the causes"), "format: 1\n"))
    changed = replace(robot, body_changes=body_changes(tree.bodies, nuisance.links))
    model = RobotModel(apply_patch(changed, patch) if effects else changed)
    applied = apply_to_plant(model, patch)
    for step in STEPS:
        options = PlantOptions(RATE, seed=0, noise=False, step=step, shortest_step=step)
        plant = RolloutPlant(model, [], None, options, applied)
        try:
            plant.reset(np.zeros(model.n))
        except BadInput:
            if step == STEPS[-1]:
                raise
            continue
        break
    return PerturbedPlant(
        plant, applied, tuple(model.joint_names.index(name) for name in tree.joints), nuisance
    )


def effects_to_simulate(
    effects: Sequence[EffectSpec], drive: str
) -> tuple[tuple[EffectSpec, ...], tuple[LeftOut, ...]]:
    """Separates the effects that a rollout driven by one kind of torque can show from the others."""
    kept, dropped = [], []
    for spec in effects:
        effect = CATALOGUE[spec.effect]
        port: Port = next(port for port in effect.description.ports if port == spec.port)
        name = f"{spec.effect} on {', '.join(spec.parameters)}"
        if effect.bound_to_recording:
            dropped.append(LeftOut(name, "it acts at one time of one recording"))
        elif not any(effect.shows(port, residual) for residual in DOWNSTREAM[drive]):
            dropped.append(LeftOut(name, f"it does not lie between the recorded {drive} and the motion"))
        else:
            kept.append(spec)
    return tuple(kept), tuple(dropped)


def spec_of_cause(cause: Cause) -> EffectSpec:
    """Writes a cause as an entry of a patch."""
    entry = patch_entry(cause)
    parameters = {
        key: {symbol: PatchQuantity(e.value, e.unit, None) for symbol, e in symbols.items()}
        for key, symbols in entry.parameters.items()
    }
    return EffectSpec(entry.effect, entry.joints, entry.port, parameters, {})


@dataclass(frozen=True, eq=False)
class FittedNuisance:
    """Changes (10 n,) of the links' parameters and of the weights that the robot compensates; additional delay [s]."""

    links: Array
    weights: Array
    delay: float


def fitted_nuisance(evidence: Evidence) -> FittedNuisance:
    """Reads the nuisance parameters of the accepted model's fit."""
    found = evidence.model_fit.whole.coefficients
    prior = inertia_prior(evidence.prepared[0].tree.inertia)
    size = len(prior)
    rate = evidence.prepared[0].log.rate
    return FittedNuisance(
        links=found[:size] * prior,
        weights=found[size : 2 * size] * prior * WEIGHT_PRIOR / INERTIA_PRIOR,
        delay=float(found[2 * size] * TIMING_PRIOR / rate),
    )


def no_nuisance(tree: RigidTree) -> FittedNuisance:
    """The nominal model as it is."""
    zero = np.zeros(10 * len(tree.bodies))
    return FittedNuisance(zero, zero, 0.0)


def body_changes(bodies: Sequence[Body], links: Array) -> tuple[BodyChange, ...]:
    """Turns the links' changes (10 n,) into changes of a robot's bodies, as far as every body stays physical."""
    out = []
    for body, change in zip(bodies, links.reshape(-1, 10), strict=True):
        for halved in range(HALVINGS):
            part = change * 0.5**halved
            if part.any() and _physical(body.inertia + part):
                out.append(BodyChange(body.link, tuple(float(value) for value in part)))
                break
    return tuple(out)


def _physical(parameters: Array) -> bool:
    """Whether the pseudo-inertia of ten parameters is positive definite."""
    eigenvalues = np.linalg.eigvalsh(pseudo_inertia(parameters))
    return bool(eigenvalues[0] > 1e-6 * eigenvalues[-1])


def robot_of_model(model: NominalModel, urdf: Path, drive: str, gravity_compensation: str) -> RobotSpec:
    """Builds the robot whose plant one kind of recorded torque drives.

    Args:
        model: The nominal model.
        urdf: Its links, from ``without_endless_joints``.
        drive: ``command``: the whole joint; ``motor``: rotor and link, stiffly coupled; ``effort``: the link alone.
        gravity_compensation: Of the recording; only a command leaves it to the robot.
    """
    moving = [name for name, joint in read_urdf(urdf).joints.items() if joint.moves]
    return RobotSpec(
        name=model.robot,
        urdf=urdf,
        limbs={},
        joints={name: _joint(model, index, drive) for index, name in enumerate(model.joints)},
        locked={name: 0.0 for name in moving if name not in model.joints},
        mirror=None,
        timing=TimingSpec(RATE, 1.0, RATE, model.command_delay if drive == "command" else 0.0, 1.0),
        sensors=SensorSpec(0.0, 0.0, 0.0, 0.0, 0.0),
        contact_detection=ContactDetectionSpec(FAR, 1.0),
        collision=CollisionSpec((), 0.0),
        gravity_compensation=gravity_compensation if drive == "command" else "none",
        control_modes=("torque",),
        solver="daqp",
        folder=urdf.parent,
    )


@contextmanager
def without_endless_joints(urdf: Path) -> Iterator[Path]:
    """Gives a URDF in which continuous joints are revolute with distant limits, so that each has one coordinate."""
    tree = ET.parse(urdf)
    endless = [joint for joint in tree.getroot().findall("joint") if joint.attrib.get("type") == "continuous"]
    if not endless:
        yield urdf
        return
    for joint in endless:
        joint.attrib["type"] = "revolute"
        for limit in joint.findall("limit"):
            joint.remove(limit)
        ET.SubElement(joint, "limit", lower=str(-FAR), upper=str(FAR), velocity=str(FAR), effort=str(FAR))
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / urdf.name
        tree.write(copy)
        yield copy


def _joint(model: NominalModel, index: int, drive: str) -> JointSpec:
    compliance, limit = float(model.compliance[index]), float(model.effort_max[index])
    whole = JointSpec(
        name=model.joints[index],
        position_min=-FAR,
        position_max=FAR,
        velocity_max=FAR,
        effort_max=limit if np.isfinite(limit) else FAR,
        effort_rate_max=FAR,
        spring_stiffness=1.0 / compliance if compliance > 0.0 else None,
        reflected_inertia=float(model.reflected_inertia[index]),
        motor_damping=float(model.motor_damping[index]),
        spring_damping=float(model.spring_damping[index]),
        encoder=model.encoders[index] if model.encoders else None,
    )
    if drive == "command":
        return whole
    # An encoder at the motor reads the spring's twist, too, whatever drives the joint.
    stiff = whole if whole.encoder == "motor" else replace(whole, spring_stiffness=None)
    return stiff if drive == "motor" else replace(stiff, reflected_inertia=0.0, motor_damping=0.0)
