# SPDX-License-Identifier: BSD-3-Clause
"""The effects this version knows, by id: a new effect is one line here."""

from __future__ import annotations

from collections.abc import Iterable

from impedance_modules.effects import (
    bodies,
    clock,
    controller_gain,
    drive_effects,
    external_contact,
    hysteresis,
    joint_friction,
    joint_transmission,
    object_inertia,
    sensor_effects,
    springs,
    surface_effects,
    transmission_coupling,
    water,
)
from impedance_modules.effects.effect import Effect
from impedance_modules.errors import BadInput
from impedance_modules.installed import EFFECTS, installed, loaded
from impedance_modules.spec.schema import allow_effect

_EFFECTS: tuple[Effect, ...] = (
    joint_friction.CoulombFriction(),
    joint_friction.ViscousFriction(),
    joint_friction.StribeckFriction(),
    joint_friction.QuadraticDrag(),
    joint_friction.AsymmetricFriction(),
    joint_friction.LoadDependentFriction(),
    joint_friction.FrictionDrift(),
    sensor_effects.TorqueOffset(),
    joint_transmission.ReflectedInertia(),
    sensor_effects.TorqueGain(),
    sensor_effects.EncoderOffset(),
    joint_transmission.Backlash(),
    hysteresis.Hysteresis(),
    joint_transmission.JointElasticity(),
    bodies.Payload(),
    bodies.LinkInertia(),
    bodies.BaseTilt(),
    springs.ParallelSpring(),
    springs.TorqueRipple(),
    drive_effects.CommandDelay(),
    drive_effects.ActuatorLag(),
    drive_effects.TorqueSaturation(),
    sensor_effects.Crosstalk(),
    sensor_effects.VelocityFilterLag(),
    clock.ClockDrift(),
    external_contact.ExternalContact(),
    controller_gain.ControllerGain(),
    transmission_coupling.TransmissionCoupling(),
    surface_effects.SurfaceHeight(),
    surface_effects.SurfaceStiffness(),
    surface_effects.SurfaceFriction(),
    object_inertia.ObjectInertia(),
    water.Buoyancy(),
    water.AddedMass(),
    water.FluidDrag(),
    springs.BenchSpring(),
)


CATALOGUE: dict[str, Effect] = {effect.id: effect for effect in _EFFECTS}
"""Effect id -> effect, in the order in which they are tried and printed; those of other packages come last."""


def add_effect(effect: Effect) -> None:
    """Adds an effect of somebody else's to the catalogue: to be applied, searched for and printed like the others.

    Raises:
        BadInput: It is no effect, or its id is taken.
    """
    if not isinstance(effect, Effect) or effect.id in CATALOGUE:
        raise BadInput(f"{effect!r} (valid: an instance of a subclass of Effect with an id of its own)")
    CATALOGUE[effect.id] = effect
    allow_effect(effect.id)


def add_missing_effects(effects: Iterable[Effect]) -> None:
    """Adds those effects that are not there: what another process has added to its catalogue.

    Raises:
        BadInput: One is no effect.
    """
    for effect in effects:
        if effect.id not in CATALOGUE:
            add_effect(effect)


def add_installed_effects() -> None:
    """Adds the effects of other installed packages; again does nothing.

    Raises:
        BadInput: One cannot be imported, is no effect, or goes by another id than its entry point.
    """
    for name in installed(EFFECTS):
        if name in CATALOGUE:
            continue
        effect = loaded(EFFECTS, name)()
        if not isinstance(effect, Effect) or effect.id != name:
            raise BadInput(
                f"'{name}' of {EFFECTS} is {effect!r} (valid: a subclass of Effect with the id '{name}')"
            )
        add_effect(effect)


def not_searched(*, under_water: bool) -> frozenset[str]:
    """Ids that the diagnosis does not look for by itself; what water does only where the robot is said to be in it."""
    wanted = {"always", "under_water"} if under_water else {"always"}
    return frozenset(effect.id for effect in CATALOGUE.values() if effect.searched not in wanted)


def first_excitation() -> tuple[str, ...]:
    """Ids that a first recording, without any suspicion, should tell apart on every joint that it moves."""
    ranks = {effect.id: effect.first_excitation for effect in CATALOGUE.values()}
    return tuple(sorted((name for name, rank in ranks.items() if rank), key=lambda name: ranks[name] or 0))
