# SPDX-License-Identifier: BSD-3-Clause
r"""A position loop with other gains than stated: torque that follows the tracking error.

A controller answers whatever it does not expect with an error that looks like it. So the error counts as far as it
follows from the motion asked for, and a loop is softer only by a part of the stiffness that its own command shows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.compiled import compiled
from impedance_modules.effects.effect import NEEDED, Effect, Values
from impedance_modules.effects.effect_description import Description, Port, joint_parameter
from impedance_modules.effects.joint_motion import CompiledTorque, JointMotion, Shape
from impedance_modules.effects.plant_builder import PlantBuilder
from impedance_modules.effects.regressor import Regressor, Site, one_row
from impedance_modules.effects.residual_kinds import Residual, Stage
from impedance_modules.effects.simulator_numbers import Exported
from impedance_modules.records import Record, Vector

ANSWER = 2.0 / 3.0
"""Part of the stiffness that a command shows, beyond which a loop softer by it is the controller's own answer."""

SURE = 2.0
"""Standard errors by which that stiffness may be less."""

PIECES = 4
"""Pieces of a recording, of which one at a time is left out."""

SIGN = 0.05
"""Speed over which a fed-forward dry friction turns its sign [rad/s]."""


class ControllerGain(Effect):
    """Torque from the tracking error beyond the controller's stated one."""

    description = Description(
        id="controller_gain",
        sentence="The drive's position loop is stiffer or softer than stated: it adds torque from the tracking error.",
        equation="motor torque = u + dkp (q_cmd - q) + dkd (v_cmd - v)",
        parameters=(
            joint_parameter("dkp", "N.m/rad", "stiffness beyond the stated one"),
            joint_parameter(
                "dkd", "N.m.s/rad", "damping beyond the stated one", left_out="the stated one is right"
            ),
        ),
        ports=("actuator",),
        places={"actuator": "drive"},
        signature="follows the tracking error, not the motion",
        confusable_with=("viscous_friction", "reflected_inertia", "parallel_spring"),
        excitation="two sets of gains, with the position command recorded",
        reference="Isaac Sim system identification (stiffness and damping gains)",
        applied="The plant: at the motor, from the joint motion that its driver aims at (Plant.aim).",
    )
    exported = (
        Exported(
            "servo gains", "K_p = dkp, K_d = dkd", lambda values: (values["dkp"], values.get("dkd", 0.0))
        ),
    )
    not_compensated = (
        "it belongs to the drives' own position loop, which a run does not use (valid: a patch without it)"
    )

    def computed_from_command(self, port: Port) -> bool:
        """Made of the motion asked for."""
        return True

    def proportional_to_command(self, port: Port) -> bool:
        """In proportion to the tracking error."""
        return True

    def stage(self, port: Port) -> Stage | None:
        """The drive."""
        return "drive"

    def shapes(self, site: Site) -> tuple[dict[str, float], ...]:
        """The tracking error as recorded, or as far as it follows from the commanded motion."""
        return ({}, {NEEDED: 1.0})

    def by_load(self, port: Port, shape: Mapping[str, float]) -> dict[str, float] | None:
        """The part of the error that follows from the commanded motion: the rest answers noise and disturbances."""
        return None if NEEDED in shape else {NEEDED: 1.0}

    def in_residual(self, site: Site, residual: Residual, shape: Shape) -> Regressor | None:
        """Minus the tracking error and its rate."""
        signals, joint = site.signals, site.joint
        command = signals.position_command if NEEDED not in shape else signals.aimed
        if command is None:
            return None
        aim = command[:, joint]
        error = aim - signals.position[:, joint]
        rate = signals.rate_of(aim) - signals.velocity[:, joint]
        return one_row(joint, -np.stack([error, rate], axis=1), lower=-np.inf)

    def contradicted(self, values: Values, sites: Sequence[Site]) -> str | None:
        """A loop that is softer by what the controller itself asks for: its answer to a disturbance of any kind.

        A torque d that no model has, a dead zone or stiction, makes the controller ask for k (q_cmd - q) = d more:
        dkp = -k explains it, whatever it is. What is near to that, for all that the command shows of k, says nothing
        about the loop.
        """
        asked = _stiffness_asked(sites) if values["dkp"] < 0.0 else None
        if asked is None or -values["dkp"] <= ANSWER * (asked[0] - SURE * asked[1]):
            return None
        return (
            "takes back what the controller answers: any disturbance would look so "
            f"(dkp {values['dkp']:.3g}, the command itself shows {asked[0]:.3g} +- {asked[1]:.2g} N.m/rad)"
        )

    def apply_to_plant(self, builder: PlantBuilder, port: Port, parameters: Mapping[str, Values]) -> None:
        """Closes a loop around joints."""
        stiffness, damping = np.zeros(builder.model.n), np.zeros(builder.model.n)
        joints = builder.joints(parameters)
        stiffness[joints] = [values["dkp"] for values in parameters.values()]
        damping[joints] = [values.get("dkd", 0.0) for values in parameters.values()]
        builder.torques.append(TrackingTorque(stiffness, damping))


def _stiffness_asked(sites: Sequence[Site]) -> tuple[float, float] | None:
    r"""Stiffness k of a joint's controller as its own command shows it, and its standard error [N.m/rad].

    u = k e + d \dot e + c \cdot (q_cmd, v_cmd, a_cmd, \sigma(v_cmd), \tau(q_cmd), \tau_g(q_cmd), \tau_g(q))

    with e = q_cmd - q: what is fed forward follows from the motion asked for, and weights may be those of where the
    joint is. Nothing of the real motion's torque is in it: u equals that torque but for what is to be explained. Nor
    is a constant: an error that stays answers one. The standard error is a jackknife's over pieces of the recordings,
    whose samples follow each other. None where no motion, or no torque, was asked for.
    """
    pieces: list[Array] = []
    for site in sites:
        signals, joint = site.signals, site.joint
        aim, drive = signals.position_command, signals.drive
        if aim is None or drive is None:
            return None
        rate = signals.rate_of(aim)[:, joint]
        columns = np.column_stack(
            [
                aim[:, joint] - signals.position[:, joint],
                rate - signals.velocity[:, joint],
                aim[:, joint],
                rate,
                signals.rate_of(rate),
                np.tanh(rate / SIGN),
                *(torque[:, joint] for torque in (*signals.torque_of_aim, signals.weight)),
                drive[:, joint],
            ]
        )
        pieces += np.array_split(columns, PIECES)
    return _first_of_jackknife(np.array([piece.T @ piece for piece in pieces]))


def _first_of_jackknife(products: Array) -> tuple[float, float]:
    """First coefficient of least squares and its error by leaving out one piece at a time.

    Args:
        products: (pieces, p + 1, p + 1) of the p columns and, last, of what they explain.
    """
    scale = np.sqrt(np.diagonal(products.sum(axis=0)))
    scale[scale == 0.0] = 1.0
    scaled = products / np.outer(scale, scale)

    def first(sums: Array) -> float:
        return float(np.linalg.lstsq(sums[:-1, :-1], sums[:-1, -1], rcond=None)[0][0])

    left_out = np.array([first(scaled.sum(axis=0) - piece) for piece in scaled])
    spread = np.sqrt((len(scaled) - 1) * np.mean((left_out - left_out.mean()) ** 2))
    unit = scale[-1] / scale[0]
    return first(scaled.sum(axis=0)) * unit, float(spread) * unit


class TrackingState(Record):
    """A loop around joints: dkp and dkd, (n,) each [N.m/rad], [N.m.s/rad]."""

    stiffness: Vector
    damping: Vector


@compiled
def add_tracking_torque(gains: TrackingState, motion: JointMotion, torque: Vector) -> None:
    """Adds dkp (q_cmd - q) + dkd (v_cmd - v) [N.m]."""
    for i in range(torque.size):
        error = motion.position_command[i] - motion.position[i]
        rate = motion.velocity_command[i] - motion.velocity[i]
        torque[i] += gains.stiffness[i] * error + gains.damping[i] * rate


class TrackingTorque(CompiledTorque):
    """Torque from the plant's own tracking error."""

    port: Literal["motor", "link"] = "motor"
    law = add_tracking_torque

    def __init__(self, stiffness: Array, damping: Array) -> None:
        """Takes (n,) each [N.m/rad], [N.m.s/rad]."""
        self.state = TrackingState(stiffness=stiffness, damping=damping)
