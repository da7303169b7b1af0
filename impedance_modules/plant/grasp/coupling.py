# SPDX-License-Identifier: BSD-3-Clause
r"""How the hands take hold of the object at the start: the load they carry, and the couplings' rest.

The start is a static equilibrium: the hands' wrenches on the object sum to minus its weight (where the
arms carry it), and each presses with the declared squeeze. The couplings' rest is set so that they carry
exactly these wrenches at the start pose, f = k e, t = k_r e_r.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impedance_modules.plant.grasp import HeldObject, pressing_direction, principal_inertia
from impedance_modules.plant.plant_state import BODY, Row, Table
from impedance_modules.robot.pose import carry
from impedance_modules.robot.rotation import exp3

Array = NDArray[np.float64]

GRASP_LINEAR_STIFFNESS = 3e5
"""Of the coupling between a hand and a held object [N/m]: a thousand times a task's 300 N/m."""

GRASP_ANGULAR_STIFFNESS = 5e3
"""Of the same coupling [N.m/rad]: several hundred times a task's 10 N.m/rad."""

GRASP_DAMPING_TIME = 1e-4
"""Damping of the coupling over its stiffness [s]: a tenth of critical at 2000 rad/s."""

PALM_RADIUS = 0.03
"""Of the patch through which a friction grasp passes torque, at most mu N PALM_RADIUS [m]."""


def body_table(held: HeldObject | None, gravity: Array) -> Table:
    """Tabulates the object, or its absence, at rest in world axes."""
    body = np.zeros(1, BODY)
    for name in ("rotation", "change", "turned"):
        body[name] = np.eye(3)
    if held is not None:
        spec = held.spec
        body["present"], body["mass"], body["gravity"] = True, spec.mass, gravity
        body["inertia"] = principal_inertia(spec.shape, spec.size, spec.mass)
    return body


def prepare_hands(hands: Table, frames: tuple[str, ...], held: HeldObject) -> None:
    """Writes the constants of every holding hand's coupling."""
    for hand, frame in zip(hands, frames, strict=True):
        hand["holds"] = frame in held.hands
        hand["slips"] = held.spec.friction is not None and held.spec.grasp == "friction"
        hand["friction"] = 0.0 if held.spec.friction is None else held.spec.friction
        hand["palm_radius"] = PALM_RADIUS
        hand["linear_stiffness"] = GRASP_LINEAR_STIFFNESS
        hand["angular_stiffness"] = GRASP_ANGULAR_STIFFNESS
        hand["linear_damping"] = GRASP_LINEAR_STIFFNESS * GRASP_DAMPING_TIME
        hand["angular_damping"] = GRASP_ANGULAR_STIFFNESS * GRASP_DAMPING_TIME


def take_hold(hands: Table, body: Table, held: HeldObject, position: Array) -> Array:
    """Sets the couplings' rest at the start pose; returns the wrench of the object on each hand (h, 6)."""
    holding = [i for i in range(hands.size) if hands[i]["holds"]]
    rotation = body[0]["rotation"]
    wrench = np.zeros((hands.size, 6))
    for i in holding:
        hand = hands[i]
        hand["point"] = rotation.T @ (hand["translation"] - position)
        hand["normal"] = pressing_direction(held.spec.shape, held.spec.size, hand["point"])
        wrench[i, :3] = -held.spec.squeeze * (rotation @ hand["normal"])
    if holding and held.spec.carry_weight:
        weight = np.concatenate([body[0]["mass"] * body[0]["gravity"], np.zeros(3)])
        offsets = [rotation @ hands[i]["point"] for i in holding]
        wrench[holding] += _share(weight, wrench[holding], offsets)
    for i in holding:
        _set_rest(hands[i], rotation, position, wrench[i])
    return wrench


def _share(load: Array, pressed: Array, offsets: list[Array]) -> Array:
    """Adds the smallest wrenches (h, 6) on the hands that bring object and hands into equilibrium."""
    maps = np.hstack([carry(offset).T for offset in offsets])
    missing = load - maps @ pressed.reshape(-1)
    added, *_ = np.linalg.lstsq(maps, missing, rcond=None)
    return np.asarray(added.reshape(-1, 6))


def _set_rest(hand: Row, rotation: Array, position: Array, wrench: Array) -> None:
    """Winds one coupling so that it puts ``wrench`` on the hand at the present pose."""
    stretch = wrench[:3] / hand["linear_stiffness"]
    twist = wrench[3:] / hand["angular_stiffness"]
    hand["point"] = rotation.T @ (hand["translation"] + stretch - position)
    hand["turn"] = rotation.T @ exp3(twist) @ hand["rotation"]
    hand["stretch"], hand["twist"] = stretch, twist
    hand["pressure"] = max(0.0, -float(wrench[:3] @ (rotation @ hand["normal"])))
