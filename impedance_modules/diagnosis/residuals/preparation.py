# SPDX-License-Identifier: BSD-3-Clause
r"""From a log to its residuals: torque that the real joints need beyond the model, in one frequency band.

Which residuals exist follows from what was measured (see `effects.residuals`): actuator and link with a joint
sensor, motor with a motor's torque, whole with a command alone, and velocity, the reported against the
differentiated one.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar, cast

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.data.encoder_grid import mean_rounding
from impedance_modules.diagnosis.data.log import Log
from impedance_modules.diagnosis.data.nominal_model import NominalModel
from impedance_modules.diagnosis.data.rigid_dynamics import (
    BatchedRigidModel,
    gravity_regressor,
    inertial_regressor,
    inverse_dynamics,
)
from impedance_modules.diagnosis.data.rigid_tree import RigidTree
from impedance_modules.diagnosis.data.time_base import delayed
from impedance_modules.diagnosis.data.torque_jumps import jump_sizes
from impedance_modules.diagnosis.residuals.band import Band, CommonBand, above_noise, deflection_cutoffs
from impedance_modules.effects.catalogue import CATALOGUE
from impedance_modules.effects.effect import predicted
from impedance_modules.effects.effect_description import Port
from impedance_modules.effects.patch_check import numbers
from impedance_modules.effects.recorded_signals import Signals, differentiate
from impedance_modules.effects.regressor import Site
from impedance_modules.effects.residual_kinds import Residual
from impedance_modules.spec.patch_file import EffectSpec

AppliedEffect = tuple[str, Port, Mapping[str, Mapping[str, float]]]
"""Id of an effect, its port, and key -> symbol -> value."""
Record = TypeVar("Record", "Prepared", Signals, Log)
FILTERED_MIN = 50
"""Least samples of a path before a segment that are filtered."""

SPRING_ROUNDS = 2
"""Times that a spring's load is computed from the motion of a link that it moves."""


@dataclass(frozen=True, eq=False)
class Prepared:
    """One recording with its residuals and the columns of what is uncertain in the nominal model.

    Attributes:
        log: The recording, thinned.
        tree: The rigid bodies.
        band: Its filter.
        signals: Motion and torques for the effects' columns, at the log's rate.
        residuals: Name -> (M, n) residual in the band, thinned to M samples.
        link_nuisance: (M, n, 10 n) columns of the bodies' inertial parameters, by accelerations above their noise.
        weight_nuisance: (M, n, 10 n) likewise of the weight alone, which the robot compensates.
        timing_nuisance: (M, n) change of the residual per second of additional command delay.
        reading_nuisance: (M, n) change of the effort per second that its readings are early.
        assistance_nuisance: (M, n) change of what the robot adds by itself per second that its own reading is early.
        filter_nuisance: (M, n) T^2 d^2 v / dt^2, the second order of the velocities' filter [rad/s].
        grid_nuisance: (M, n) what the grid of an effort would add to the torque asked for, or needed [N.m].
        command_jumps, effort_jumps: (N, n) jumps of torques, whose instant between two rows is unknown [N.m].
        time, position, velocity, acceleration, load: (M,) or (M, n) for regimes and ranges.
    """

    log: Log
    tree: RigidTree
    band: Band
    signals: Signals
    residuals: Mapping[Residual, Array]
    link_nuisance: Array
    weight_nuisance: Array
    timing_nuisance: Array
    reading_nuisance: Array
    assistance_nuisance: Array
    filter_nuisance: Array
    grid_nuisance: Array
    command_jumps: Array
    effort_jumps: Array
    time: Array
    position: Array
    velocity: Array
    acceleration: Array
    load: Array

    @property
    def samples(self) -> int:
        """M, the number of samples kept."""
        return len(self.time)


def prepare(
    log: Log,
    model: NominalModel,
    rigid: BatchedRigidModel,
    common: CommonBand,
    known_effects: Sequence[EffectSpec] = (),
) -> Prepared:
    """Computes a log's residuals against the model with the known effects of a patch applied."""
    jumps = [_jumps(log, torque, common) for torque in (log.command, log.effort)]
    log = _thinned(log, common)
    band = common.at(log.rate)
    reading = band.smooth(log.position)
    time = log.start + np.arange(log.samples) / log.rate
    q = _link_position(log, model, band, time, reading)
    v = differentiate(q, time)
    a = differentiate(v, time)
    a_clean = above_noise(log.position, a, log.rate)
    weight = gravity_regressor(model.tree, reading)  # the robot knows its readings only
    signals = _signals(log, model, rigid, band, (time, q, v, a, a_clean), weight @ model.tree.inertia)
    regressor = inertial_regressor(model.tree, q, v, a_clean)
    calm = replace(signals, acceleration=a_clean)
    effort = signals.effort
    torque = inverse_dynamics(model.tree, q, v, a)
    residuals = {
        name: band.condense(values - effect_torque(_known(known_effects), signals, name))
        for name, values in _residuals(log, model, signals, torque).items()
    }
    load = effort if effort is not None else torque
    found = Prepared(
        log=log,
        tree=model.tree,
        band=band,
        signals=signals,
        residuals=residuals,
        link_nuisance=band.condense(
            signals.through_springs(regressor, range(signals.n), of_accelerations=True)
        ),
        weight_nuisance=band.condense(weight),
        timing_nuisance=band.condense(
            signals.rate_of(signals.drive if signals.drive is not None else 0.0 * q)
        ),
        reading_nuisance=band.condense(signals.rate_of(0.0 * q if effort is None else effort)),
        assistance_nuisance=band.condense(
            signals.rate_of(0.0 * q if signals.assistance is None else signals.assistance)
        ),
        filter_nuisance=band.condense(
            model.velocity_filter**2 * signals.rate_of(signals.rate_of(signals.encoder_velocity))
        ),
        grid_nuisance=band.condense(_grid_errors(log, model, calm, regressor @ model.tree.inertia)),
        command_jumps=jumps[0],
        effort_jumps=jumps[1],
        time=band.pick(signals.time),
        position=band.pick(q),
        velocity=band.pick(v),
        acceleration=band.pick(a),
        load=band.pick(load),
    )
    return _in_one_piece(found)


def _link_position(log: Log, model: NominalModel, band: Band, time: Array, reading: Array) -> Array:
    """Positions (N, n) of the links: behind encoders at the motors, by what the nominal springs give."""
    at_motor = np.array([side == "motor" for side in model.encoders or (None,) * model.n])
    compliance = model.compliance * at_motor
    if not compliance.any():
        return reading
    if log.effort is not None and log.effort_source == "joint_sensor":
        return np.asarray(reading - compliance * band.smooth(log.effort))
    q = reading
    for _ in range(SPRING_ROUNDS):
        v = differentiate(q, time)
        q = reading - compliance * inverse_dynamics(model.tree, q, v, differentiate(v, time))
    return q


def _grid_errors(log: Log, model: NominalModel, signals: Signals, torque: Array) -> Array:
    """What the efforts' grids would add to the torque at the sensor, (N, n): as asked for, or as the model needs it.

    A fraction of a step decides what is rounded where, so of each joint the one is taken that is nearer to its reading:
    the command, if the drive follows it; what the links need, if nothing but them is moved. The motion's noise has no
    place in what the model needs: it is often larger than a step.

    Args:
        log: With the grids.
        model: For the rotors.
        signals: The motion, without the noise of its accelerations.
        torque: (N, n) that the links need for it [N.m].
    """
    if log.effort_steps is None or log.effort_dither is None or signals.effort is None:
        return np.zeros_like(torque)
    rotor = signals.motor_acceleration * model.reflected_inertia
    at_motor = log.effort_source == "motor"
    sensed = torque + rotor if at_motor else torque
    if signals.drive is not None:
        asked = signals.drive if at_motor else signals.drive - rotor
        off = [np.mean((signals.effort - one) ** 2, axis=0) for one in (asked, sensed)]
        sensed = np.where(off[0] < off[1], asked, sensed)
    return mean_rounding(sensed, log.effort_steps, log.effort_dither)


def _jumps(log: Log, torque: Array | None, common: CommonBand) -> Array:
    """Jumps of a torque, (N, n) at the thinned log's rate; of one that has to be thinned the instants are known."""
    if torque is None or common.thinning > 1:
        return np.zeros_like(log.position[:: common.thinning])
    return jump_sizes(log, torque)


def _signals(
    log: Log,
    model: NominalModel,
    rigid: BatchedRigidModel,
    band: Band,
    motion: tuple[Array, Array, Array, Array, Array],
    carried: Array,
) -> Signals:
    """Inputs of the effects' columns: filtered motion (time, q, v, a, a above its noise), torques, the drive."""
    time, q, v, a, a_clean = motion
    found = Signals(
        model=rigid,
        time=time,
        position=q,
        velocity=v,
        acceleration=a,
        clean_acceleration=a_clean,
        effort=None if log.effort is None else band.smooth(log.effort),
        drive=_drive(log, model, carried, band),
        assistance=carried if log.gravity_compensation == "robot" and log.command is not None else None,
        position_command=log.position_command,
        reflected_inertia=model.reflected_inertia,
        motor_damping=model.motor_damping,
        # Without a measured effort this is not used.
        effort_source="motor" if log.effort_source == "motor" else "joint_sensor",
        spring_compliance=model.compliance,
        encoders=model.encoders,
        deflection_cutoffs=deflection_cutoffs(log),
        reported_velocity=None if log.velocity is None else band.smooth(log.velocity),
        velocity_filter=model.velocity_filter,
        path_before=_path_before(log, band),
    )
    return _in_one_piece(found)


def _path_before(log: Log, band: Band) -> Array | None:
    """Path (K, n) before a segment, filtered as its own is; None where it is too short for that."""
    path = log.path_before
    return None if path is None or len(path) < FILTERED_MIN else band.smooth(path)


def _residuals(log: Log, model: NominalModel, s: Signals, torque: Array) -> dict[Residual, Array]:
    """Torque that enters a port minus the torque that the model predicts behind it, (N, n) each."""
    found: dict[Residual, Array] = {}
    rotor = s.motor_acceleration * model.reflected_inertia + s.motor_velocity * model.motor_damping
    if s.effort is not None and log.effort_source == "joint_sensor":
        # The spring is the sensor: torque through the spring's damping is not in the reading.
        through = s.effort + model.spring_damping * s.spring_compliance * s.rate_of(s.effort)
        found["link"] = through - torque
        if s.drive is not None:
            found["actuator"] = s.drive - through - rotor
    elif s.effort is not None:
        found["motor"] = s.effort - torque - rotor
        if s.drive is not None:
            found["drive"] = s.drive - s.effort
    elif s.drive is not None:
        found["whole"] = s.drive - torque - rotor
    if log.velocity is not None and s.reported_velocity is not None:
        found["velocity"] = log.velocity - s.stated_velocity
    return found


def effect_torque(effects: Iterable[AppliedEffect], signals: Signals, residual: Residual) -> Array:
    """What effects with known numbers add to a residual, (N, n)."""
    total = np.zeros((signals.samples, signals.n))
    for name, port, parameters in effects:
        for key, values in parameters.items():
            total += predicted(CATALOGUE[name], Site(signals, key, port), residual, values)
    return total


def _known(known_effects: Sequence[EffectSpec]) -> Iterator[AppliedEffect]:
    """Effects of a patch, their units stripped."""
    for spec in known_effects:
        parameters = {key: numbers(symbols) for key, symbols in spec.parameters.items()}
        yield spec.effect, cast("Port", spec.port), parameters


def _drive(log: Log, model: NominalModel, weight: Array, band: Band) -> Array | None:
    """Torque of the motors: the delayed command, plus the weight where the robot adds it."""
    if log.command is None:
        return None
    time = np.arange(log.samples) / log.rate
    late = delayed(log.command, time, model.command_delay)
    smooth = band.smooth(late)
    return smooth + weight if log.gravity_compensation == "robot" else smooth


def _thinned(log: Log, common: CommonBand) -> Log:
    def take(values: Array | None) -> Array | None:
        return None if values is None else common.thin(values)

    thinned = replace(
        log,
        rate=log.rate / common.thinning,
        position=common.thin(log.position),
        velocity=take(log.velocity),
        effort=take(log.effort),
        command=take(log.command),
        position_command=take(log.position_command),
        in_contact=None if log.in_contact is None else common.thin_mask(log.in_contact),
        carrying=None if log.carrying is None else common.thin_mask(log.carrying),
        rounding=take(log.rounding),
        path_before=take(log.path_before),
    )
    return _in_one_piece(thinned)


def _in_one_piece(record: Record) -> Record:
    """The same with arrays laid out as another process would send them, which hold no more than their own samples."""
    values = {place.name: getattr(record, place.name) for place in fields(record)}
    whole: dict[str, Any] = {
        name: np.ascontiguousarray(value) for name, value in values.items() if isinstance(value, np.ndarray)
    }
    return replace(record, **whole)
