# SPDX-License-Identifier: BSD-3-Clause
"""The effects this version knows, by id."""

from __future__ import annotations

from collections.abc import Mapping

from impedance_modules.effects.bodies import BaseTilt, LinkInertia, Payload
from impedance_modules.effects.drive_effects import (
    ActuatorLag,
    CommandDelay,
    ControllerGain,
    TorqueSaturation,
)
from impedance_modules.effects.effect import Effect
from impedance_modules.effects.external_contact import ExternalContact
from impedance_modules.effects.hysteresis import Hysteresis
from impedance_modules.effects.joint_friction import (
    AsymmetricFriction,
    CoulombFriction,
    FrictionDrift,
    LoadDependentFriction,
    QuadraticDrag,
    StribeckFriction,
    ViscousFriction,
)
from impedance_modules.effects.joint_transmission import (
    Backlash,
    JointElasticity,
    ReflectedInertia,
    TransmissionCoupling,
)
from impedance_modules.effects.sensor_effects import (
    ClockDrift,
    Crosstalk,
    EncoderOffset,
    TorqueGain,
    TorqueOffset,
    VelocityFilterLag,
)
from impedance_modules.effects.springs import BenchSpring, ParallelSpring, TorqueRipple
from impedance_modules.effects.surface_effects import SurfaceFriction, SurfaceHeight, SurfaceStiffness
from impedance_modules.effects.water import AddedMass, Buoyancy, FluidDrag

_EFFECTS: tuple[Effect, ...] = (
    CoulombFriction(),
    ViscousFriction(),
    StribeckFriction(),
    QuadraticDrag(),
    AsymmetricFriction(),
    LoadDependentFriction(),
    FrictionDrift(),
    TorqueOffset(),
    ReflectedInertia(),
    TorqueGain(),
    EncoderOffset(),
    Backlash(),
    Hysteresis(),
    JointElasticity(),
    Payload(),
    LinkInertia(),
    BaseTilt(),
    ParallelSpring(),
    TorqueRipple(),
    CommandDelay(),
    ActuatorLag(),
    TorqueSaturation(),
    Crosstalk(),
    VelocityFilterLag(),
    ClockDrift(),
    ExternalContact(),
    ControllerGain(),
    TransmissionCoupling(),
    SurfaceHeight(),
    SurfaceStiffness(),
    SurfaceFriction(),
    Buoyancy(),
    AddedMass(),
    FluidDrag(),
    BenchSpring(),
)

CATALOGUE: Mapping[str, Effect] = {effect.id: effect for effect in _EFFECTS}
"""Effect id -> effect, in the contract's order (design 3.3)."""

WATER = frozenset({"buoyancy", "added_mass", "fluid_drag"})
"""What water does: not looked for in a recording unless told that the robot was under water."""

SURFACES = frozenset({"surface_height", "surface_stiffness", "surface_friction"})
"""Errors of a task's map: worn by the plant; looked for only where a recording says what it pressed on."""

BENCH = frozenset({"bench_spring"})
"""What somebody fixed to the robot: told to the diagnosis by a patch (``--effects``), not looked for; unknown, a
spring is named ``parallel_spring``, whose law at the links is the same."""
