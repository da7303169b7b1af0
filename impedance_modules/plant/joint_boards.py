# SPDX-License-Identifier: BSD-3-Clause
r"""A plant whose joint boards are told what to do, joint by joint: torque, a position servo, a brake, or nothing.

    tau_m    = command + assist + clip(K_s (theta_s - theta) - D_s w, effort_max)
    tau_link = push + preload - k q

The servo acts on the motor's side. It is what a robot's own position and velocity modes, its hold and, with
K_s = 0, a passive brake are made of. The robot's help with the arms' weight can be switched off joint by joint.
Pushes and built-in springs act on the links; both are held over one period.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from impedance_modules.effects.motion import JointMotion
from impedance_modules.effects.worn import WornPlant
from impedance_modules.plant.effects_port import unworn
from impedance_modules.plant.joints import structural_stiffness
from impedance_modules.plant.options import PlantOptions
from impedance_modules.plant.plant import Plant
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.robot import ParallelSpringSpec
from impedance_modules.spec.task import SurfaceSpec

Array = NDArray[np.float64]


@dataclass(frozen=True)
class BoardOrders:
    """What the joint boards are told for one period, all (n,).

    Attributes:
        effort: Torque command [N.m], beyond what the robot adds by itself.
        stiffness, damping: Of the servo, K_s [N.m/rad] and D_s [N.m.s/rad]; zero where there is none.
        position: Where it pulls the motor to, theta_s [rad].
        assisted: 1.0 where the robot carries the arm's weight and its parallel springs, else 0.0.
    """

    effort: Array
    stiffness: Array
    damping: Array
    position: Array
    assisted: Array


class LinkTorque:
    """Torque on the links that is the same at every stage of a period."""

    port: Literal["motor", "link"] = "link"

    def __init__(self, torque: Array) -> None:
        """Takes a live (n,) array [N.m]."""
        self._torque = torque

    def torque(self, motion: JointMotion) -> Array:  # noqa: ARG002 - the protocol's signature
        """Gives it."""
        return self._torque

    def settle(self, motion: JointMotion) -> None:
        """Remembers nothing."""


class DrivenPlant(Plant):
    """Simulated reality under a robot that has control modes of its own.

    ``drive`` replaces ``advance``; ``hold`` and ``release`` are left alone: whoever drives the boards decides them.
    Orders act one command delay after they were given, torque and servo alike.

    Attributes:
        push: (n,) torque of the surroundings on the joints [N.m]; write to push.
    """

    def __init__(
        self,
        model: RobotModel,
        options: PlantOptions,
        worn: WornPlant | None,
        springs: dict[str, ParallelSpringSpec],
        surfaces: Sequence[SurfaceSpec] = (),
    ) -> None:
        """Builds the plant.

        Args:
            model: The robot.
            options: How it is stepped.
            worn: What reality does beyond the model; None for nothing.
            springs: Joint -> spring beside it that the robot knows and compensates with the weight.
            surfaces: Its surroundings.
        """
        worn = unworn(model) if worn is None else worn
        places = [model.joint_names.index(name) for name in springs]
        self._stiffness, self._preload = np.zeros(model.n), np.zeros(model.n)
        self._stiffness[places] = [spring.stiffness for spring in springs.values()]
        self._preload[places] = [spring.preload for spring in springs.values()]
        self.push: Array = np.zeros(model.n)
        self._on_links = np.zeros(model.n)
        self._boards: deque[BoardOrders] = deque()
        known = replace(
            worn,
            spring_stiffness=worn.spring_stiffness + self._stiffness,
            spring_preload=worn.spring_preload + self._preload,
        )
        super().__init__(model, surfaces, None, options, known)
        # The springs carry part of the weight from the start.
        self._start.on_links = self._on_links
        # Without effects the compiled stages take the torque from the table; with them it must be asked for.
        self._asked = bool(self.torques or worn.coupling.any())
        if self._asked:
            self.torques.append(LinkTorque(self._on_links))

    def reset(self, q: Array) -> None:
        """Puts everything at rest at q (n,) [rad], the weight carried (see ``Plant.reset``)."""
        self._weight.share = np.ones(self.model.n)
        self._on_links[:] = self._springs(q)
        super().reset(q)
        nothing = np.zeros(self.model.n)
        at_rest = BoardOrders(self.start_command.copy(), nothing, nothing, q.copy(), np.ones(self.model.n))
        self._boards = deque([at_rest] * self.delay)

    def widen_stops(self, by: float) -> None:
        """Moves the mechanical stops beyond the declared limits by an angle [rad]."""
        self._memory.joints["lower"] -= by
        self._memory.joints["upper"] += by

    def servo_gains(self) -> tuple[Array, Array]:
        """Gives a servo as stiff as the joints' own springs, critically damped for the rotors alone, (n,) each."""
        stiffness = np.array([structural_stiffness(joint) for joint in self.model.joints])
        return stiffness, 2.0 * np.sqrt(stiffness * self.model.reflected_inertia)

    def contact_torque(self) -> Array:
        """Gives the torque of all surfaces on the joints (n,) [N.m], of the last step."""
        memory = self._memory
        return np.asarray(np.einsum("hri,hr->i", memory.jacobian, memory.wrench[:-1, 0]))

    @property
    def assistance(self) -> Array:
        """What the robot adds by itself in the present period (n,) [N.m]."""
        return np.array(self._memory.joints["assist"])

    def compensation(self, position: Array) -> tuple[Array, Array]:
        """Gives what the robot would add for the links' weight and for the springs it knows (n,), (n,) [N.m]."""
        springs = self._worn.spring_stiffness * position - self._worn.spring_preload
        return self._weight.full(position) - springs, springs

    def drive(self, orders: BoardOrders) -> None:
        """Lives through one period under the orders of one command delay ago, and takes new ones."""
        self._boards.append(orders)
        acting = self._boards.popleft()
        joints = self._memory.joints
        joints["hold_stiffness"], joints["hold_damping"] = acting.stiffness, acting.damping
        joints["hold_position"] = acting.position
        self._weight.share = acting.assisted
        np.add(self.push, self._springs(self._memory.part("position")), out=self._on_links)
        if not self._asked:
            joints["extra_link"] = self._on_links
        self.advance(orders.effort)

    def _springs(self, position: Array) -> Array:
        """Computes the torque of the built-in springs on the joints (n,) [N.m]."""
        return self._preload - self._stiffness * position
