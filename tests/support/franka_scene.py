# SPDX-License-Identifier: BSD-3-Clause
"""The surroundings of a task in the scene of simulated FR3 (franky-sim): its tables, and its object in both hands.

The object is welded to the hands, as the task says. Before a run the arms are tried at zero torque, when they do not
carry the object. So a person holds it: a body of the scene that is welded to it, and lets go once all arms have been
commanded torques for ``HANDED_OVER``. The object touches the tables alone, by the stiffness and damping of the task.
"""

from __future__ import annotations

from typing import Any
from xml.etree import ElementTree

import numpy as np

from impedance_modules.backends.mujoco.contact_law import CONTACT_IMPEDANCE, FRICTION_RATE, softness
from impedance_modules.backends.mujoco.robot_bodies import quaternion
from impedance_modules.backends.mujoco.surroundings import geometry_size
from impedance_modules.control.assembly import assemble

HANDED_OVER = 0.8
"""How long all arms are commanded torques before the person lets go [s]."""

PERIOD = 0.001
"""Of the simulator [s]."""

SHOULDER = 0.333
"""Height of the first joint above an arm's base [m]."""

TIP = 0.1034
"""Of the gripper, in front of the simulator's hand [m]."""

WELD = "0.004 1"
"""Time constant [s] and damping ratio of all welds: they yield 0.1 mm under the weight of the object."""

OBJECT, PERSON = "object", "person"


class TaskScene:
    """What a task says of arms and surroundings.

    Attributes:
        posture: Where each limb begins, in the order of the robot file [rad].
        bases: Place of each limb's base [m].
    """

    def __init__(self, task: str) -> None:
        """Reads a task whose arms hold an object by welds, above horizontal planes."""
        assembly = assemble(task, effects=None, rate=None, scale=1.0, arm=None)
        model, limbs = assembly.model, assembly.model.limbs.values()
        start, held = assembly.modules.posture, assembly.task.object
        self._surfaces = assembly.task.environment
        if held is None or held.grasp != "weld" or held.hinge is not None:
            raise ValueError(f"{task}: no object that is welded to the hands")
        if any(surface.surface != "plane" for surface in self._surfaces):
            raise ValueError(f"{task}: a surface that is no plane")
        self._held = held
        self.posture = [tuple(start[limb.joints].tolist()) for limb in limbs]
        self.bases = [
            tuple((model.joint_place(limb.joint_names[0]) - [0.0, 0.0, SHOULDER]).tolist()) for limb in limbs
        ]
        self._grasps = {
            k: model.pose(start, limb.hand) for k, limb in enumerate(limbs) if limb.name in held.held_by
        }
        between = np.mean([hand.translation for hand in self._grasps.values()], axis=0)
        self._place = between if held.position is None else np.array(held.position)
        self._commanded = 0.0

    def add_to(self, simulator: Any) -> None:
        """Adds tables, object and person to a scene that has the arms and is not started yet."""
        world, contacts = simulator.worldbody, simulator.scene.find("contact")
        held, welds, untouched = (
            self._held,
            simulator.scene.find("equality"),
            {"contype": 0, "conaffinity": 0},
        )
        body = element(world, "body", name=OBJECT, pos=self._place)
        element(body, "freejoint", name=OBJECT)
        size = geometry_size(held.size)
        element(body, "geom", name=OBJECT, type=held.shape, size=size, mass=held.mass, **untouched)
        for k, surface in enumerate(self._surfaces):
            flat, friction = geometry_size(None), [surface.friction] * 2 + [0.0, 0.0, 0.0]
            element(
                world, "geom", name=table(k), type="plane", size=flat, pos=[0, 0, surface.height], **untouched
            )
            element(contacts, "pair", name=table(k), geom1=OBJECT, geom2=table(k), friction=friction)
        element(world, "body", name=PERSON, mocap="true", pos=self._place)
        element(welds, "weld", name=PERSON, body1=PERSON, body2=OBJECT, solref=WELD)
        for k, hand in self._grasps.items():
            palm = world.find(f".//body[@name='robot{k}_hand']")
            element(palm, "site", name=grasp(k, "hand"), pos=[0, 0, TIP])
            away, turned = hand.translation - self._place, quaternion(hand.rotation)
            element(body, "site", name=grasp(k, OBJECT), pos=away, quat=turned)
            element(welds, "weld", site1=grasp(k, "hand"), site2=grasp(k, OBJECT), solref=WELD)

    def soften_tables(self, simulator: Any) -> None:
        """Gives the tables of a started simulator the task's stiffness and damping."""
        model = simulator.model
        lightness = float(model.body_invweight0[model.body(OBJECT).id, 0])
        for k, surface in enumerate(self._surfaces):
            soft = softness(surface.stiffness, surface.damping, lightness, CONTACT_IMPEDANCE)
            pair = model.pair(table(k)).id
            model.pair_solref[pair], model.pair_solimp[pair] = soft.solref, soft.solimp
            model.pair_solreffriction[pair] = (0.0, -FRICTION_RATE * CONTACT_IMPEDANCE)

    def step(self, simulator: Any, servers: list[Any]) -> None:
        """Lets the person go once both hands carry the object; called after each step."""
        person = simulator.data.eq_active[simulator.model.equality(PERSON).id :][:1]
        if not person[0]:
            return
        states = [server.robot_state for server in servers]
        commanded = all(
            state.controller_mode.name == "kExternalController" and any(state.tau_J_d) for state in states
        )
        self._commanded = self._commanded + PERIOD if commanded else 0.0
        if self._commanded >= HANDED_OVER:
            person[0] = 0


def element(parent: Any, kind: str, **attributes: object) -> Any:
    """Adds an element of MuJoCo's XML; numbers and arrays as attributes."""
    texts = {
        name: value if isinstance(value, str) else " ".join(f"{number:.12g}" for number in np.ravel(value))
        for name, value in attributes.items()
    }
    return ElementTree.SubElement(parent, kind, texts)


def table(index: int) -> str:
    """Names the shape of a task's plane, and its contact with the object."""
    return f"table{index}"


def grasp(arm: int, side: str) -> str:
    """Names a site that is welded: of an arm's hand, or of the object."""
    return f"grasp{arm}/{side}"
