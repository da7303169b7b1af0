# SPDX-License-Identifier: BSD-3-Clause
"""The double's mind: one tick of the robot's own loop after another, without any network.

    requests -> power and stops -> modes, time-outs, cuffs, collisions -> joint boards -> plant -> sensors

Other threads only ``post`` requests; everything happens in the thread that calls ``tick``.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from impedance_modules.backends.baxter.fake.assembly_state import AssemblyMachine
from impedance_modules.backends.baxter.fake.boards import INERTIA_TICKS, Boards, Claim
from impedance_modules.backends.baxter.fake.field import ForceField
from impedance_modules.backends.baxter.fake.limb import CommandMode, Doing, LimbDrive
from impedance_modules.backends.baxter.fake.numbers import (
    COLLISION_PAUSE,
    STOP_MARGIN,
    TICK,
)
from impedance_modules.backends.baxter.fake.options import FakeOptions
from impedance_modules.backends.baxter.fake.push import Push, contact_sense
from impedance_modules.backends.baxter.fake.suppression import Suppressions
from impedance_modules.effects.worn import WornPlant
from impedance_modules.plant.joint_servos import DrivenPlant
from impedance_modules.plant.plant import PlantOptions
from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.state import RobotState
from impedance_modules.spec.robot import ParallelSpringSpec

Array = NDArray[np.float64]
Request = Callable[[], None]

FIELD_TICKS = 10
"""The force field and the hands' poses are brought up to date every so many ticks."""


class FakeBaxter:
    """A two-armed robot with modes, safety and moods of its own.

    Attributes:
        model: Its kinematics and dynamics, calibrated mounts included.
        plant: What really happens.
        machine: Power and stops.
        limbs: Name -> control modes and time-out.
        suppressions: Name -> safety functions that are kept off.
        cuffs: Name -> whether its cuff is squeezed.
        pushes: Name -> who pushes it; None while nobody does.
        colliding: Name -> what it pauses for, ``impact`` or ``squish``; empty while it does not.
        field: Force field.
        kinematics: Of the hands, as fresh as the force field.
        state: What the sensors said last.
        now: Clock [s], from 0.
        events: (time, text) of everything worth telling.
    """

    def __init__(
        self, model: RobotModel, worn: WornPlant | None, posture: Array, options: FakeOptions
    ) -> None:
        """Builds the robot, standing still at a posture (n,) [rad]; compiles what it needs."""
        self.model, self.options = model, options
        springs = {
            limb.joint_names[limb.short_names.index(short)]: ParallelSpringSpec(*spring)
            for limb in model.limbs.values()
            for short, spring in options.springs.items()
        }
        plant_options = PlantOptions(rate=1.0 / TICK, seed=options.seed, noise=options.noise)
        self.plant = DrivenPlant(model, plant_options, worn, springs)
        self.plant.widen_stops(STOP_MARGIN)
        self.plant.warm(posture)
        self._boards = Boards(model, self.plant)
        self.machine = AssemblyMachine(enabled=options.enabled)
        limbs = model.limbs
        self.limbs = {name: LimbDrive(model, limb, options) for name, limb in limbs.items()}
        self.suppressions = {name: Suppressions() for name in limbs}
        self.cuffs = dict.fromkeys(limbs, False)
        self.pushes: dict[str, Push | None] = dict.fromkeys(limbs)
        self.colliding = dict.fromkeys(limbs, "")
        self._senses = {name: contact_sense(limb.short_names) for name, limb in limbs.items()}
        self.kinematics = Kinematics(model, tuple(limb.hand for limb in limbs.values()))
        self.field = ForceField(self.kinematics, FIELD_TICKS * TICK)
        self.state: RobotState = self.plant.sense()
        self.now = 0.0
        self.events: list[tuple[float, str]] = []
        self._ticks = 0
        self._inbox: deque[Request] = deque()
        self._powered = False
        self._look_around()

    def post(self, request: Request) -> None:
        """Hands a request to the next tick; safe from any thread."""
        self._inbox.append(request)

    def command(self, limb: str, mode: int, names: Sequence[str], values: Sequence[float]) -> None:
        """Takes a JointCommand; without power it is ignored."""
        drive = self.limbs[limb]
        drive.received += 1
        drive.last_received = self.now
        if mode == CommandMode.TORQUE:
            drive.last_torque = self.now
        if not self.machine.standing.enabled:
            drive.ignored += 1
            return
        drive.take(self.now, mode, names, values, self.position(drive))
        if drive.fault:
            self.say(drive.fault)
            self.machine.fault()
            drive.fault = ""

    def enable(self, wish: bool) -> None:
        """Takes a request to switch power on or off."""
        before = self.machine.standing
        if wish:
            self.machine.enable(blocked=self._blocked())
        else:
            self.machine.disable()
        if self.machine.standing != before:
            self.say("enabled" if wish else "disabled")
        elif self.machine.refusal:
            self.say(f"not enabled: {self.machine.refusal}")

    def reset(self) -> None:
        """Takes a request to clear faults and stops."""
        self.machine.reset()
        self.say(f"not reset: {self.machine.refusal}" if self.machine.refusal else "reset")

    def stop(self) -> None:
        """Takes a request to stop by software."""
        self.machine.stop()
        self.say("stopped by software")

    def _blocked(self) -> str:
        """Says which arm must not be powered because its collision flag cannot clear."""
        for name, near in self.field.near.items():
            if near and not self.suppressions[name].active("suppress_collision_avoidance", self.now):
                return f"{name} is inside the force field of {', '.join(near)}"
        return ""

    def say(self, text: str) -> None:
        """Notes what happened; what is said again and again is noted once."""
        if not self.events or self.events[-1][1] != text:
            self.events.append((self.now, text))

    def position(self, drive: LimbDrive) -> Array:
        """Gives the measured positions of a limb (k,) [rad]."""
        return np.asarray(self.state.position[drive.limb.joints])

    def integral_effort(self, drive: LimbDrive) -> Array:
        """Gives what a limb's position servo has built up against its error (k,) [N.m]."""
        return np.asarray(self._boards.stiffness[drive.limb.joints] * drive.reference.integral)

    def tick(self) -> None:
        """Lives through one millisecond."""
        while self._inbox:
            self._inbox.popleft()()
        self._watch_power()
        for name, drive in self.limbs.items():
            self._watch_limb(name, drive)
        self.plant.drive(self._boards.orders(self.state, self._claims(), self.field.torque))
        self.state = self.plant.sense()
        self._ticks += 1
        self.now = self._ticks * TICK
        if self._ticks % FIELD_TICKS == 0:
            self._look_around()

    def _look_around(self) -> None:
        self.kinematics.update(self.state.position, self.state.velocity)
        self.field.update(self.state.position, self.state.velocity)
        if self._ticks % INERTIA_TICKS == 0:
            self._boards.weigh(self.state.position)

    def _watch_power(self) -> None:
        """Without power every mode is forgotten; with it the arms hold where they are."""
        powered = self.machine.standing.enabled
        if powered != self._powered:
            for drive in self.limbs.values():
                drive.settle(self.position(drive))
            self._powered = powered

    def _watch_limb(self, name: str, drive: LimbDrive) -> None:
        """Time-out, cuff and collisions of one limb."""
        self._feel(name, drive)
        if not self._powered:
            return
        squeezed = self.cuffs[name] and not self.suppressed(name, "suppress_cuff_interaction")
        if squeezed and drive.doing is not Doing.FLOATS:
            self.say(f"{name}: cuff squeezed, the arm yields")
        if squeezed:
            drive.float_free()
        elif drive.doing is Doing.FLOATS and self.options.time_out_result != "float":
            drive.settle(self.position(drive))
        drive.check_time(self.now)
        if drive.expired:
            self._time_out(name, drive)

    def _time_out(self, name: str, drive: LimbDrive) -> None:
        """What silence leads to: sources disagree, so the options say."""
        moving = drive.mode in (CommandMode.TORQUE, CommandMode.VELOCITY)
        result = self.options.time_out_result if moving else "hold"
        self.say(f"{name}: no command for {drive.time_out:g} s: {result}")
        if result == "float":
            drive.float_free()
        else:
            drive.settle(self.position(drive))
        if result == "disable":
            self.machine.disable()
            self._watch_power()

    def _feel(self, name: str, drive: LimbDrive) -> None:
        """Lets a push act, and pauses the limb if it is a collision."""
        push, joints = self.pushes[name], drive.limb.joints
        if push is None and self._senses[name].idle and not self.colliding[name]:
            return
        if push is not None and self.now >= push.end:
            push = self.pushes[name] = None
        torque = np.zeros(joints.size)
        if push is not None:
            torque = self.kinematics.jacobian_of(drive.limb.hand)[:3, joints].T @ push.force
        self.plant.push[joints] = torque
        felt = self._senses[name].detect(torque)
        if not drive.paused(self.now):
            self.colliding[name] = ""
        if felt and self._powered and not self.suppressed(name, "suppress_contact_safety"):
            if not self.colliding[name]:
                self.say(f"{name}: {felt}, the arm pauses")
                drive.pause(self.now, COLLISION_PAUSE, self.position(drive))
            self.colliding[name] = felt

    def _claims(self) -> list[Claim] | None:
        """What each limb wants of its boards; None without power."""
        if not self._powered:
            return None
        return [
            Claim(
                drive,
                assisted=not self.suppressed(name, "suppress_gravity_compensation"),
                kept_off=not self.suppressed(name, "suppress_collision_avoidance"),
            )
            for name, drive in self.limbs.items()
        ]

    def suppressed(self, limb: str, what: str) -> bool:
        """Says whether a safety function of a limb is kept off now."""
        return self.suppressions[limb].active(what, self.now)
