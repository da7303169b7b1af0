# SPDX-License-Identifier: BSD-3-Clause
r"""Effects within a step: their torques at every stage, what they remember at its end, and coupled motors.

An effect is a row of addresses: of its law, of what it does at a step's end, and of its state. The step calls them
without knowing them: another patch needs no other machine code for the step, and a new effect only its own.

The rotors of two motors can be coupled, by an inertia C beside their own:

    e = -C \ddot z,      \ddot z = (1 + S C)^{-1} \ddot z_0

z are the motors of elastic joints and the links of all others, \ddot z_0 their acceleration without e, S what a
torque on them accelerates.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.compiled import call, compiled, state_at
from impedance_modules.effects.joint_motion import (
    CompiledTorque,
    JointHistory,
    JointMotion,
    joint_motion,
    take_from_history,
)
from impedance_modules.effects.link_poses import PlacedLinks, empty_poses
from impedance_modules.errors import BadInput
from impedance_modules.plant.joints import ELASTIC
from impedance_modules.plant.links import accelerate
from impedance_modules.records import Flag, Indices, Matrix, Record, Table, Vector, new_table

if TYPE_CHECKING:
    from impedance_modules.plant.plant_state import PlantState, StateVector

EFFECT = np.dtype(
    [("law", np.int64), ("ending", np.int64), ("state", np.int64), ("motor", np.int64)], align=True
)
"""One effect: addresses of law, of ending (0: none) and of state, and whether it acts at the motors."""


class EffectTorques(Record):
    """The effects that act as torques on joints.

    Attributes:
        watched: Whether there are effects: in ``rows``, in Python, or coupled motors.
        rows: Of ``EFFECT``, in the order in which they are asked.
        at_stage: The joints at the present stage, with the step's time, load and commands.
        at_step: The joints at the step's start, or its end.
        motor, link: (n,) sums of their torques [N.m].
        coupled: (k,) joints whose motors are coupled.
        coupling: (k, k) rotor inertia that couples them [kg.m^2]; symmetric, zero diagonal.
        trial, response: (n,) a torque on the links, and what it accelerates.
    """

    watched: Flag
    rows: Annotated[Table, EFFECT]
    at_stage: JointMotion
    at_step: JointMotion
    motor: Vector
    link: Vector
    coupled: Indices
    coupling: Matrix
    trial: Vector
    response: Vector

    def __reduce__(self) -> tuple[Any, ...]:
        if self.rows.size:
            raise BadInput(
                "a plant with effects cannot be copied (valid: a new one, of the same robot and patch)"
            )
        return super().__reduce__()


@compiled
def observe_links(plant: PlantState, poses: PlacedLinks) -> None:
    """Writes where the links stand, as they were placed last."""
    links = plant.links
    for b in range(links.size):
        link = links[b]
        for k in range(3):
            poses.translation[b, k] = link.translation[k]
            poses.axis[b, k], poses.axis[b, 3 + k] = link.axis[k], link.axis[3 + k]
            for r in range(3):
                poses.rotation[b, r, k] = link.rotation[r, k]


@compiled
def observe_joints(plant: PlantState, motion: JointMotion) -> None:
    """Writes commands and loads of this moment."""
    for i in range(plant.joints.size):
        joint = plant.joints[i]
        motion.command[i], motion.load[i] = joint.command, joint.load
        motion.drive[i] = joint.command + joint.assist


@compiled
def begin_effects(plant: PlantState) -> None:
    """Shows the effects the joints at the step's start."""
    if plant.effects.watched:
        observe_joints(plant, plant.effects.at_stage)


@compiled
def evaluate_effects(plant: PlantState) -> None:
    """Writes what effects add at the stage, the links placed already."""
    effects = plant.effects
    if not effects.watched:
        return
    observe_links(plant, effects.at_stage.links)
    effects.motor[:], effects.link[:] = 0.0, 0.0
    for e in range(effects.rows.size):
        row = effects.rows[e]
        torque = effects.motor if row.motor else effects.link
        call(row.law, state_at(row.state), effects.at_stage, torque)
    for i in range(plant.joints.size):
        plant.joints[i].effect_motor, plant.joints[i].effect_link = effects.motor[i], effects.link[i]


@compiled
def end_effects(plant: PlantState, step: float) -> None:
    """Lets effects remember the step's end."""
    effects = plant.effects
    if effects.watched:
        effects.at_stage.time += step
        effects.at_step.time = effects.at_stage.time
        observe_joints(plant, effects.at_step)
        remember(effects)


@compiled
def remember(effects: EffectTorques) -> None:
    """Tells the effects the joints at a step's end."""
    for e in range(effects.rows.size):
        row = effects.rows[e]
        if row.ending != 0:
            call(row.ending, state_at(row.state), effects.at_step)


@compiled
def remember_history(effects: EffectTorques, history: JointHistory) -> None:
    """Tells the effects every motion of a history but the first."""
    for k in range(1, history.time.size):
        take_from_history(history, k, effects.at_step)
        remember(effects)


@compiled
def couple_motors(plant: PlantState) -> bool:
    """Adds the torque with which one rotor's acceleration loads another motor, at an evaluated stage.

    Returns whether a motor among them moves its link directly: then the links accelerate differently.
    """
    effects, joints = plant.effects, plant.joints
    coupled, coupling, k = effects.coupled, effects.coupling, effects.coupled.size
    lightness, alone, direct = np.zeros((k, k)), np.zeros(k), False
    for b in range(k):
        j = coupled[b]
        if joints[j].kind == ELASTIC:
            alone[b] = plant.rate.motor_velocity[j]
            lightness[b, b] = 1.0 / joints[j].reflected_inertia
            continue
        direct = True
        alone[b] = plant.acceleration[j]
        effects.trial[:] = plant.torque
        effects.trial[j] += 1.0
        accelerate(plant.links, plant.stage.velocity, effects.trial, effects.response)
        for a in range(k):
            if joints[coupled[a]].kind != ELASTIC:
                lightness[a, b] = effects.response[coupled[a]] - plant.acceleration[coupled[a]]
    together = np.linalg.solve(np.eye(k) + np.dot(lightness, coupling), alone)
    for a in range(k):
        for b in range(k):
            joints[coupled[a]].effect_motor -= coupling[a, b] * together[b]
    return direct


def effect_torques(
    count: int, start: StateVector, stage: StateVector, *, links: Table, coupling: Array
) -> EffectTorques:
    """Makes room for a number of effects that see a plant's states and links.

    Args:
        count: Number of effects.
        start: State at the step's start.
        stage: State at the present stage.
        links: (n + 1,) of ``LINK``.
        coupling: (n, n) rotor inertia that couples motors [kg.m^2].
    """
    n = start.position.size
    poses, position_command, velocity_command = empty_poses(n), np.zeros(n), np.zeros(n)
    poses.parent[:] = links["parent"]

    def seen(state: StateVector) -> JointMotion:
        return joint_motion(
            n,
            poses,
            position=state.position,
            velocity=state.velocity,
            motor_position=state.motor_position,
            motor_velocity=state.motor_velocity,
            position_command=position_command,
            velocity_command=velocity_command,
        )

    coupled = np.flatnonzero(coupling.any(axis=0))
    return EffectTorques(
        watched=count > 0 or coupled.size > 0,
        rows=new_table(count, EFFECT),
        at_stage=seen(stage),
        at_step=seen(start),
        motor=np.zeros(n),
        link=np.zeros(n),
        coupled=coupled,
        coupling=np.ascontiguousarray(coupling[np.ix_(coupled, coupled)]),
        trial=np.zeros(n),
        response=np.zeros(n),
    )


def connect(effects: EffectTorques, torques: Sequence[CompiledTorque]) -> None:
    """Writes where each effect's laws and state are now."""
    for row, torque in zip(effects.rows, torques, strict=True):
        row["law"], row["ending"] = torque.addresses(effects.at_stage)
        row["state"], row["motor"] = torque.state.address, torque.port == "motor"
