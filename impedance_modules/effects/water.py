# SPDX-License-Identifier: BSD-3-Clause
"""A link under water: it is lifted, takes water along when it speeds up, and is held back as it moves.

The three effects of the thesis's section 6.2.5 in still water, one link at a time; they add (Morison et al.
1950). Each acts at a point of the link; several entries on one link make a long link out of short pieces.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.compiled import compiled
from impedance_modules.effects.bodies import CENTRE, MassAtPoint, by_axis, centre_of, place_on_link
from impedance_modules.effects.effect import Effect, Values
from impedance_modules.effects.effect_description import Description, Parameter, Port
from impedance_modules.effects.joint_motion import CompiledTorque, JointMotion, Shape, joint_motion
from impedance_modules.effects.link_poses import (
    add_point_force,
    on_joint_axes,
    point_of_link,
    point_velocity,
    poses_at,
)
from impedance_modules.effects.plant_builder import PlantBuilder
from impedance_modules.effects.regressor import Regressor, Site, all_rows
from impedance_modules.effects.residual_kinds import Residual
from impedance_modules.records import Array3, Indices, Matrix, Record, Vector
from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.rotation import dot, turn, turn_back

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
    of_accelerations = True
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


class LiftState(Record):
    """Water displaced by k links.

    Attributes:
        bodies: (k,) rows of the links.
        weight: (k, 3) upwards, in base axes [N].
        centre: (k, 3) in the links' joints' axes [m].
        point: (3,) a centre now [m].
    """

    bodies: Indices
    weight: Matrix
    centre: Matrix
    point: Vector


@compiled
def add_lift(lift: LiftState, motion: JointMotion, torque: Vector) -> None:
    """Adds J_c^T (-m g) summed over links [N.m]."""
    for k in range(lift.bodies.size):
        point_of_link(motion.links, lift.bodies[k], lift.centre[k], lift.point)
        add_point_force(motion.links, lift.bodies[k], lift.point, lift.weight[k], torque)


class BuoyancyTorque(CompiledTorque):
    """The weight of displaced water, upwards."""

    port: Literal["motor", "link"] = "link"
    law = add_lift

    def __init__(self, model: RobotModel, links: Mapping[str, tuple[float, Array]]) -> None:
        """Takes link -> mass of the displaced water [kg] and its centre (3,) in the link's frame [m]."""
        self._model = model
        places = [on_joint_axes(model, link, centre) for link, (_, centre) in links.items()]
        up = -np.array(model.pin_model.gravity.linear)
        self.state = LiftState(
            bodies=np.array([body for body, _, _ in places], dtype=np.int64),
            weight=np.array([mass * up for mass, _ in links.values()]),
            centre=np.array([centre for _, centre, _ in places]),
            point=np.zeros(3),
        )

    def lift(self, position: Array) -> Array:
        """Gives what lifts the links at joint positions (n,) [rad], as a torque (n,) [N.m]."""
        return self.torque(joint_motion(self._model.n, poses_at(self._model, position)))


class DragState(Record):
    """Resistance to k links.

    Attributes:
        bodies: (k,) rows of the links.
        drag: (k, 3) along the links' axes [N.s^2/m^2].
        place: (k, 3) where it acts, in the links' joints' axes [m].
        axes: (k, 3, 3) turns the links' axes into their joints'.
        point, velocity, along, force: (3,) of the link at hand, the first two and the last in base axes.
    """

    bodies: Indices
    drag: Matrix
    place: Matrix
    axes: Array3
    point: Vector
    velocity: Vector
    along: Vector
    force: Vector


@compiled
def add_drag(water: DragState, motion: JointMotion, torque: Vector) -> None:
    """Subtracts J_c^T |v| D v summed over links [N.m], D in the link's axes."""
    along, force = water.along, water.force
    for k in range(water.bodies.size):
        body = water.bodies[k]
        rotation = motion.links.rotation[body]
        point_of_link(motion.links, body, water.place[k], water.point)
        point_velocity(motion.links, body, water.point, motion.velocity, water.velocity)
        turn_back(rotation, water.velocity, force)
        turn_back(water.axes[k], force, along)
        speed = np.sqrt(dot(along, along))
        for r in range(3):
            along[r] *= -water.drag[k, r] * speed
        turn(water.axes[k], along, water.velocity)
        turn(rotation, water.velocity, force)
        add_point_force(motion.links, body, water.point, force, torque)


class DragTorque(CompiledTorque):
    """Resistance -|v| D v at a point of each link, v that point's velocity in the link's axes."""

    port: Literal["motor", "link"] = "link"
    law = add_drag

    def __init__(self, model: RobotModel, links: Mapping[str, tuple[Array, Array]]) -> None:
        """Takes link -> drag (3,) along its axes [N.s^2/m^2] and the point (3,) in its frame [m]."""
        places = [on_joint_axes(model, link, point) for link, (_, point) in links.items()]
        self.state = DragState(
            bodies=np.array([body for body, _, _ in places], dtype=np.int64),
            drag=np.array([drag for drag, _ in links.values()], dtype=float),
            place=np.array([place for _, place, _ in places]),
            axes=np.array([axes for _, _, axes in places]),
            point=np.zeros(3),
            velocity=np.zeros(3),
            along=np.zeros(3),
            force=np.zeros(3),
        )
