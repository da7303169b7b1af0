# SPDX-License-Identifier: BSD-3-Clause
"""A link under water: it is lifted, takes water along when it speeds up, and is held back as it moves.

The three effects of the thesis's section 6.2.5 in still water, one link at a time; they add (Morison et al.
1950). Each acts at a point of the link; several entries on one link make a long link out of short pieces.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np
import pinocchio as pin

from impedance_modules.arrays import Array
from impedance_modules.effects.bodies import CENTRE, MassAtPoint, by_axis, centre_of, place_on_link
from impedance_modules.effects.effect import Effect, Regressor, Site, Values, all_rows
from impedance_modules.effects.effect_description import Description, Parameter, Port
from impedance_modules.effects.joint_motion import EffectTorque, JointMotion, Shape
from impedance_modules.effects.plant_builder import PlantBuilder
from impedance_modules.effects.residual_kinds import Residual
from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.rotation import skew

MASSES = ("mx", "my", "mz")

INERTIAS = ("Ix", "Iy", "Iz")

DRAGS = ("dx", "dy", "dz")


BENEATH = "it ends where the water ends, and the controller does not know the surface (valid: --effects)"
"""Why what water does is not compensated."""


class WaterAtPoint(Effect):
    """What water does at a known point of a link, along each of its axes.

    Attributes:
        sizes: Symbols of the effect's size by axis; zero where left out.
        none: What is wrong with an effect of which all are left out.
    """

    searched = "under_water"
    shape = CENTRE
    sizes: tuple[str, ...]
    none: str
    not_exported = (
        "water at a point of a link, with numbers for each axis of it, is not among a body's numbers"
    )
    not_compensated = BENEATH

    def shapes(self, site: Site) -> tuple[dict[str, float], ...]:
        """The link's nominal centre of mass, near which the centre of what it displaces lies; it is not refined."""
        return (by_axis(site.signals.model.centre(site.key)),)

    def next_shape(self, values: Values, shape: Mapping[str, float]) -> dict[str, float]:
        """Stays where it is."""
        return dict(shape)

    def relations(self, values: Values) -> list[str]:
        """Some direction must be given."""
        return [] if any(name in values for name in self.sizes) else [self.none]


class Buoyancy(MassAtPoint):
    """The weight of the water that a link displaces, upwards."""

    description = Description(
        id="buoyancy",
        sentence="A link is under water, which lifts it by the weight of what it displaces.",
        equation="tau = J_c^T m g, m = rho V the displaced water's mass, g gravity, J_c of (cx, cy, cz) on the link",
        parameters=(
            Parameter("m", "kg", "mass of the displaced water, rho V", lower=0.0),
            *place_on_link("centre of the displaced volume"),
        ),
        ports=("link",),
        places={"link": "surroundings"},
        keys=("body",),
        signature="weight missing on all joints before the link, in fixed proportions; none of it when it speeds up",
        confusable_with=("link_inertia", "torque_offset", "base_tilt", "encoder_offset"),
        excitation="static poses; fast motion tells it from missing mass, which would be missing there too",
        reference="Archimedes' principle; Fossen 2011, Handbook of Marine Craft Hydrodynamics",
        applied="The plant: a torque on the joints. Neither the model nor the robot's weight compensation knows it.",
    )
    searched = "under_water"
    not_compensated = BENEATH
    not_exported = "a lift at a point of a link that is not its centre of mass is not among a body's numbers"

    def in_residual(self, site: Site, residual: Residual, shape: Shape) -> Regressor | None:
        """Four columns, of m and m c: minus the weight of a body with these moments."""
        signals = site.signals
        return self.of_moments(-signals.model.weight_of_body(site.key, signals.position))

    def apply_to_plant(self, builder: PlantBuilder, port: Port, parameters: Mapping[str, Values]) -> None:
        """Lifts links."""
        lifted = {link: (values["m"], centre_of(values)) for link, values in parameters.items()}
        builder.torques.append(BuoyancyTorque(builder.model, lifted))


class AddedMass(WaterAtPoint):
    """Water that a link takes along when it speeds up."""

    description = Description(
        id="added_mass",
        sentence="A link under water must speed up water with it: more inertia across it than along it, and no weight.",
        equation=(
            "tau = J_c^T (M_A a_c + v_c x* M_A v_c), M_A = diag(mx, my, mz, Ix, Iy, Iz) in the link's axes at"
            " (cx, cy, cz), v_c and a_c its twist and spatial acceleration there (Kirchhoff)"
        ),
        parameters=(
            *(
                Parameter(s, "kg", f"water taken along the link's {s[1]} axis", lower=0.0, left_out="none")
                for s in MASSES
            ),
            *(
                Parameter(
                    s, "kg.m^2", f"its inertia about the link's {s[1]} axis", lower=0.0, left_out="none"
                )
                for s in INERTIAS
            ),
            *place_on_link("centre of the displaced volume"),
        ),
        ports=("link",),
        places={"link": "surroundings"},
        keys=("body",),
        signature="inertia without weight on all joints before the link",
        confusable_with=("link_inertia", "reflected_inertia", "payload"),
        excitation="accelerations along and across the link, beside static poses that show the weight alone",
        reference="Kirchhoff 1869; Lamb, Hydrodynamics, 1932, ch. 6; Fossen 2011",
        applied="The plant: the link's inertia in the articulated-body algorithm. The model does not know it.",
    )
    sizes = (*MASSES, *INERTIAS)
    none = "takes no water along in any direction"

    def in_residual(self, site: Site, residual: Residual, shape: Shape) -> Regressor | None:
        """Six columns, of what is taken along each axis and turned about it."""
        signals = site.signals
        columns = signals.model.taken_along(
            site.key,
            centre_of(shape),
            signals.position,
            signals.velocity,
            signals.acceleration,
        )
        return all_rows(columns, lower=0.0)

    def apply_to_plant(self, builder: PlantBuilder, port: Port, parameters: Mapping[str, Values]) -> None:
        """Adds to links' inertia."""
        for link, values in parameters.items():
            builder.take_along(link, self.linear(values)[0], centre_of(values))


class FluidDrag(WaterAtPoint):
    """The water's resistance to a link's motion."""

    description = Description(
        id="fluid_drag",
        sentence="Water holds a moving link back, with the square of its speed, across it more than along it.",
        equation="tau = J_c^T |v| diag(dx, dy, dz) v, v of (cx, cy, cz) in the link's axes; d = rho C_d A / 2",
        parameters=(
            *(
                Parameter(
                    s, "N.s^2/m^2", f"drag along the link's {s[1]} axis, rho C_d A / 2", 0.0, left_out="none"
                )
                for s in DRAGS
            ),
            *place_on_link("where it acts"),
        ),
        ports=("link",),
        places={"link": "surroundings"},
        keys=("body",),
        signature="grows with the square of the link's own speed, on all joints before it",
        confusable_with=("quadratic_drag", "viscous_friction"),
        excitation="fast motion of one joint after the other: a joint's own drag does not reach the joints before it",
        reference="Morison et al. 1950; Fossen 2011",
        applied="The plant: a torque on the joints, always against the motion. The model does not know it.",
    )
    sizes = DRAGS
    none = "holds the link back in no direction"

    def in_residual(self, site: Site, residual: Residual, shape: Shape) -> Regressor | None:
        """Three columns."""
        signals = site.signals
        J, v = signals.model.motion_of_point(site.key, centre_of(shape), signals.position, signals.velocity)
        speed = np.linalg.norm(v, axis=1)
        columns = np.swapaxes(J, 1, 2) * (speed[:, None] * v)[:, None, :]
        return all_rows(columns, lower=0.0)

    def apply_to_plant(self, builder: PlantBuilder, port: Port, parameters: Mapping[str, Values]) -> None:
        """Holds links back."""
        held = {link: (self.linear(values)[0], centre_of(values)) for link, values in parameters.items()}
        builder.torques.append(DragTorque(builder.model, held))


class WaterTorque(EffectTorque):
    """A torque on the links that depends on where they are and how they move, and on nothing before."""

    port: Literal["motor", "link"] = "link"


class BuoyancyTorque(WaterTorque):
    """The weight of displaced water, upwards: J_c^T (-m g) summed over links.

    It is minus the weight of a robot whose links are nothing but the displaced water.
    """

    def __init__(self, model: RobotModel, links: Mapping[str, tuple[float, Array]]) -> None:
        """Takes link -> mass of the displaced water [kg] and its centre (3,) in the link's frame [m]."""
        self._water = pin.Model(model.pin_model)
        for joint in range(self._water.njoints):
            self._water.inertias[joint] = pin.Inertia.Zero()
        for link, (mass, centre) in links.items():
            frame = self._water.frames[model.frame_id(link)]
            body = pin.Inertia(mass, centre, np.zeros((3, 3)))
            self._water.appendBodyToJoint(frame.parentJoint, body, frame.placement)
        self._data = self._water.createData()

    def torque(self, motion: JointMotion) -> Array:
        """Gives what lifts the links (n,) [N.m]."""
        return self.lift(motion.position)

    def lift(self, position: Array) -> Array:
        """Gives the same at joint positions (n,) [rad]."""
        return np.array(pin.computeGeneralizedGravity(self._water, self._data, position))


class DragTorque(WaterTorque):
    """Resistance -|v| D v at a point of each link, v that point's velocity in the link's axes."""

    def __init__(self, model: RobotModel, links: Mapping[str, tuple[Array, Array]]) -> None:
        """Takes link -> drag (3,) along its axes [N.s^2/m^2] and the point (3,) in its frame [m]."""
        self._model = model.pin_model
        self._data = self._model.createData()
        self._frames = [model.frame_id(link) for link in links]
        self._drag = np.array([drag for drag, _ in links.values()])
        # v + w x p, from a twist at the link's origin to the point.
        self._to_point = [np.hstack([np.eye(3), -skew(point)]) for _, point in links.values()]

    def torque(self, motion: JointMotion) -> Array:
        """Gives what holds the links back (n,) [N.m]."""
        pin.computeJointJacobians(self._model, self._data, motion.position)
        out = np.zeros(motion.position.size)
        for frame, drag, to_point in zip(self._frames, self._drag, self._to_point, strict=True):
            J = pin.getFrameJacobian(self._model, self._data, frame, pin.ReferenceFrame.LOCAL)
            at_point = to_point @ J
            v = at_point @ motion.velocity
            out -= at_point.T @ (drag * v * np.sqrt(v @ v))
        return out
