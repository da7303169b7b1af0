# SPDX-License-Identifier: BSD-3-Clause
"""Somebody or something pushes a link for a while."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Literal

import numpy as np
import pinocchio as pin

from impedance_modules.arrays import Array
from impedance_modules.effects.effect import Effect, Regressor, Site, Values, all_rows
from impedance_modules.effects.effect_description import Description, Parameter, Port
from impedance_modules.effects.joint_motion import EffectTorque, JointMotion, Shape
from impedance_modules.effects.plant_builder import PlantBuilder
from impedance_modules.effects.residual_kinds import Residual
from impedance_modules.effects.rigid_model import WORLD_AXES
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


class LinkPush(EffectTorque):
    """A force on a link of the plant."""

    port: Literal["motor", "link"] = "link"

    def __init__(self, model: RobotModel, link: str, force: Array, window: tuple[float, float]) -> None:
        """Takes the force (3,) in base axes [N] and when it acts [s]."""
        self._model = model.pin_model
        self._data = self._model.createData()
        self._frame = model.frame_id(link)
        self._force, self._window = force, window

    def torque(self, motion: JointMotion) -> Array:
        """Gives J^T f within the window (n,) [N.m]."""
        start, end = self._window
        if not start <= motion.time < end:
            return np.zeros(motion.position.size)
        J = pin.computeFrameJacobian(self._model, self._data, motion.position, self._frame, WORLD_AXES)
        return np.asarray(J[:3].T @ self._force)
