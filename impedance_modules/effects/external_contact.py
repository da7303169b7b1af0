# SPDX-License-Identifier: BSD-3-Clause
"""Somebody or something pushes a link for a while."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Literal

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.compiled import compiled
from impedance_modules.effects.effect import Effect, Values
from impedance_modules.effects.effect_description import Description, Parameter, Port
from impedance_modules.effects.joint_motion import CompiledTorque, JointMotion, Shape
from impedance_modules.effects.link_poses import add_point_force, on_joint_axes, point_of_link
from impedance_modules.effects.plant_builder import PlantBuilder
from impedance_modules.effects.regressor import Regressor, Site, all_rows
from impedance_modules.effects.residual_kinds import Residual
from impedance_modules.records import Integer, Record, Scalar, Vector
from impedance_modules.robot.model import RobotModel

FORCE = ("fx", "fy", "fz")
WINDOWS = 10
"""Into how many pieces a recording is cut to look for a push."""


class ExternalContact(Effect):
    """A constant force on a link's origin between two instants."""

    description = Description(
        id="external_contact",
        sentence="Somebody or something pushes a link for a while with a steady force.",
        equation="tau = -J^T (fx, fy, fz) while start <= t < end, J of the link's origin, base axes",
        parameters=(
            *(Parameter(name, "N", f"force on the link along {name[1]}") for name in FORCE),
            Parameter("start", "s", "when it begins", lower=0.0),
            Parameter("end", "s", "when it ends", lower=0.0),
        ),
        ports=("contact",),
        keys=("body",),
        signature="local in time, on all joints before the link, and not there in a repeat",
        confusable_with=("payload", "torque_saturation"),
        excitation="repeats of the same motion",
        reference="De Luca & Mattone 2005; Haddadin, De Luca & Albu-Schaeffer 2017",
        applied="The plant: a force on the link.",
    )
    bound_to_recording = True
    not_exported = "it happened at one time of one recording, and is no property of the robot"
    not_compensated = "what pushes the hands is what the task is about, and no property of the robot"
    shape = ("start", "end")

    def in_residual(self, site: Site, residual: Residual, shape: Shape) -> Regressor | None:
        """Three rows of J, with minus, within the window."""
        signals = site.signals
        J = signals.model.jacobian(site.key, signals.position)[:, :3]
        within = (signals.time >= shape["start"]) & (signals.time < shape["end"])
        columns = -np.swapaxes(J, 1, 2) * within[:, None, None]
        return all_rows(columns)

    def shapes(self, site: Site) -> tuple[dict[str, float], ...]:
        """Tries pieces of the recording."""
        edges = np.linspace(site.signals.time[0], site.signals.time[-1], WINDOWS + 1)
        return tuple({"start": float(a), "end": float(b)} for a, b in pairwise(edges))

    def relations(self, values: Values) -> list[str]:
        """It ends after it begins."""
        if values["end"] <= values["start"]:
            return [f"end {values['end']:g} s is not after start {values['start']:g} s"]
        return []

    def apply_to_plant(self, builder: PlantBuilder, port: Port, parameters: Mapping[str, Values]) -> None:
        """Pushes links."""
        for link, values in parameters.items():
            force = np.array([values[name] for name in FORCE])
            builder.torques.append(LinkPush(builder.model, link, force, (values["start"], values["end"])))


class PushState(Record):
    """A force on a link.

    Attributes:
        body: Row of the link.
        offset: (3,) its frame's origin in its joint's axes [m].
        force: (3,) in base axes [N].
        start, end: When it acts [s].
        point: (3,) where it acts now [m].
    """

    body: Integer
    offset: Vector
    force: Vector
    start: Scalar
    end: Scalar
    point: Vector


@compiled
def add_push(push: PushState, motion: JointMotion, torque: Vector) -> None:
    """Adds J^T f within the window [N.m]."""
    if push.start <= motion.time < push.end:
        point_of_link(motion.links, push.body, push.offset, push.point)
        add_point_force(motion.links, push.body, push.point, push.force, torque)


class LinkPush(CompiledTorque):
    """A force on a link of the plant."""

    port: Literal["motor", "link"] = "link"
    law = add_push

    def __init__(self, model: RobotModel, link: str, force: Array, window: tuple[float, float]) -> None:
        """Takes the force (3,) in base axes [N] and when it acts [s]."""
        body, offset, _ = on_joint_axes(model, link, np.zeros(3))
        start, end = window
        self.state = PushState(body=body, offset=offset, force=force, start=start, end=end, point=np.zeros(3))
