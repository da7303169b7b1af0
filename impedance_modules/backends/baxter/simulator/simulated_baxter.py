# SPDX-License-Identifier: BSD-3-Clause
"""The simulated Baxter without its network: one tick of the robot's own loop after another.

    requests -> power and stops -> modes, time-outs, cuffs, collisions -> joint boards -> plant -> sensors

Other threads only ``post`` requests; everything else happens in the thread that calls ``tick``.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.backends.baxter.gripper_link import KIND
from impedance_modules.backends.baxter.simulator.assembly_state import PowerMachine
from impedance_modules.backends.baxter.simulator.collision_safety import (
    ForceField,
    HandPush,
    Suppressions,
    contact_sense,
)
from impedance_modules.backends.baxter.simulator.electric_gripper import ElectricGripper
from impedance_modules.backends.baxter.simulator.joint_boards import (
    INERTIA_TICKS,
    BoardRequest,
    CommandMode,
    JointBoards,
    LimbActivity,
    LimbDrive,
)
from impedance_modules.backends.baxter.simulator.parameters import (
    COLLISION_PAUSE,
    STOP_MARGIN,
    TICK,
    SimulatorOptions,
)
from impedance_modules.effects.plant_builder import PlantEffects
from impedance_modules.plant.joint_servos import DrivenPlant
from impedance_modules.plant.plant import PlantOptions
from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.state import RobotState
from impedance_modules.spec.robot_spec import ParallelSpringSpec

Request = Callable[[], None]

FIELD_TICKS = 10
"""Collision avoidance and the hands' poses are updated every so many ticks."""


class SimulatedBaxter:
    """A two-armed robot with the control modes, time-outs and safety functions of a Baxter.

    Attributes:
        model: Its kinematics and dynamics, calibrated mounts included.
        plant: The physics.
        machine: Power and stops.
        limbs: Name -> control modes and time-out.
        suppressions: Name -> safety functions that are switched off.
        cuffs: Name -> whether its cuff is squeezed.
        pushes: Name -> push that acts on it, or None.
        grippers: Name -> its electric gripper, of limbs that have one.
        colliding: Name -> why it pauses, ``impact`` or ``squish``; empty while it does not.
        field: Collision avoidance.
        kinematics: Of the hands, at the last update of ``field``.
        state: Last sensor readings.
        now: Clock [s], from 0.
        events: (time, text) of everything that is logged.
    """

    def __init__(
        self, model: RobotModel, effects: PlantEffects | None, posture: Array, options: SimulatorOptions
    ) -> None:
        """Builds the robot, standing still at a posture (n,) [rad]; compiles what it needs."""
        self.model, self.options = model, options
        springs = {
            limb.joint_names[limb.short_names.index(short)]: ParallelSpringSpec(*spring)
            for limb in model.limbs.values()
            for short, spring in options.springs.items()
        }
        plant_options = PlantOptions(rate=1.0 / TICK, seed=options.seed, noise=options.noise)
        self.plant = DrivenPlant(model, plant_options, effects, springs)
        self.plant.widen_stops(STOP_MARGIN)
        self.plant.warm(posture)
        self._boards = JointBoards(model, self.plant)
        self.machine = PowerMachine(enabled=options.enabled)
        limbs = model.limbs
        self.limbs = {name: LimbDrive(model, limb, options) for name, limb in limbs.items()}
        self.suppressions = {name: Suppressions() for name in limbs}
        self.cuffs = dict.fromkeys(limbs, False)
        self.pushes: dict[str, HandPush | None] = dict.fromkeys(limbs)
        self.grippers = {
            name: ElectricGripper(limb.gripper)
            for name, limb in model.spec.limbs.items()
            if limb.gripper is not None and limb.gripper.kind == KIND
        }
        self.colliding = dict.fromkeys(limbs, "")
        self._senses = {name: contact_sense(limb.short_names) for name, limb in limbs.items()}
        self.kinematics = Kinematics(model, tuple(limb.hand for limb in limbs.values()))
        self.field = ForceField(self.kinematics, FIELD_TICKS * TICK)
        self.state: RobotState = self.plant.sense()
        self.now = 0.0
        self.events: list[tuple[float, str]] = []
        self._ticks = 0
        self._requests: deque[Request] = deque()
        self._powered = False
        self._update_safety()

    def post(self, request: Request) -> None:
        """Queues a request for the next tick; safe from any thread."""
        self._requests.append(request)

    def command(self, limb: str, mode: int, names: Sequence[str], values: Sequence[float]) -> None:
        """Takes a JointCommand; without power it is ignored."""
        drive = self.limbs[limb]
        drive.received += 1
        drive.last_received = self.now
        if mode == CommandMode.TORQUE:
            drive.last_torque = self.now
        if not self.machine.state.enabled:
            drive.ignored += 1
            return
        drive.take(self.now, mode, names, values, self.position(drive))
        if drive.fault:
            self.log_event(drive.fault)
            self.machine.fault()
            drive.fault = ""

    def enable(self, on: bool) -> None:
        """Takes a request to switch power on or off."""
        before = self.machine.state
        if on:
            self.machine.enable(blocked=self._blocked())
        else:
            self.machine.disable()
        if self.machine.state != before:
            self.log_event("enabled" if on else "disabled")
        elif self.machine.refusal:
            self.log_event(f"not enabled: {self.machine.refusal}")

    def reset(self) -> None:
        """Takes a request to clear faults and stops."""
        self.machine.reset()
        self.log_event(f"not reset: {self.machine.refusal}" if self.machine.refusal else "reset")

    def stop(self) -> None:
        """Takes a request to stop by software."""
        self.machine.stop()
        self.log_event("stopped by software")

    def _blocked(self) -> str:
        """Says which arm must not be powered because its collision flag cannot clear."""
        for name, near in self.field.near.items():
            if near and not self.suppressions[name].active("suppress_collision_avoidance", self.now):
                return f"{name} is inside the force field of {', '.join(near)}"
        return ""

    def log_event(self, text: str) -> None:
        """Logs an event; one that repeats is logged once."""
        if not self.events or self.events[-1][1] != text:
            self.events.append((self.now, text))

    def position(self, drive: LimbDrive) -> Array:
        """Returns the measured positions of a limb (k,) [rad]."""
        return np.asarray(self.state.position[drive.limb.joints])

    def integral_effort(self, drive: LimbDrive) -> Array:
        """Returns the integral part of a limb's position servo (k,) [N.m]."""
        return np.asarray(self._boards.stiffness[drive.limb.joints] * drive.reference.integral)

    def tick(self) -> None:
        """Simulates one millisecond."""
        while self._requests:
            self._requests.popleft()()
        self._update_power()
        for name, drive in self.limbs.items():
            self._update_limb(name, drive)
        self.plant.drive(self._boards.orders(self.state, self._board_requests(), self.field.torque))
        for gripper in self.grippers.values():
            gripper.advance(TICK)
        self.state = self.plant.sense()
        self._ticks += 1
        self.now = self._ticks * TICK
        if self._ticks % FIELD_TICKS == 0:
            self._update_safety()

    def _update_safety(self) -> None:
        self.kinematics.update(self.state.position, self.state.velocity)
        self.field.update(self.state.position, self.state.velocity)
        if self._ticks % INERTIA_TICKS == 0:
            self._boards.update_inertia(self.state.position)

    def _update_power(self) -> None:
        """When power goes or comes, every mode ends and the arms hold where they are."""
        powered = self.machine.state.enabled
        if powered != self._powered:
            for drive in self.limbs.values():
                drive.settle(self.position(drive))
            self._powered = powered

    def _update_limb(self, name: str, drive: LimbDrive) -> None:
        """Time-out, cuff and collisions of one limb."""
        self._detect_collision(name, drive)
        if not self._powered:
            return
        squeezed = self.cuffs[name] and not self.suppressed(name, "suppress_cuff_interaction")
        if squeezed and drive.activity is not LimbActivity.FLOATS:
            self.log_event(f"{name}: cuff squeezed, the arm yields")
        if squeezed:
            drive.float_free()
        elif drive.activity is LimbActivity.FLOATS and self.options.time_out_result != "float":
            drive.settle(self.position(drive))
        drive.check_time(self.now)
        if drive.expired:
            self._time_out(name, drive)

    def _time_out(self, name: str, drive: LimbDrive) -> None:
        """Acts on a time-out; sources disagree about the result, so it is an option."""
        moving = drive.mode in (CommandMode.TORQUE, CommandMode.VELOCITY)
        result = self.options.time_out_result if moving else "hold"
        self.log_event(f"{name}: no command for {drive.time_out:g} s: {result}")
        if result == "float":
            drive.float_free()
        else:
            drive.settle(self.position(drive))
        if result == "disable":
            self.machine.disable()
            self._update_power()

    def _detect_collision(self, name: str, drive: LimbDrive) -> None:
        """Applies a push, and pauses the limb if it is a collision."""
        push, joints = self.pushes[name], drive.limb.joints
        if push is None and self._senses[name].idle and not self.colliding[name]:
            return
        if push is not None and self.now >= push.end:
            push = self.pushes[name] = None
        torque = np.zeros(joints.size)
        if push is not None:
            torque = self.kinematics.jacobian_of(drive.limb.hand)[:3, joints].T @ push.force
        self.plant.push[joints] = torque
        detected = self._senses[name].detect(torque)
        if not drive.paused(self.now):
            self.colliding[name] = ""
        if detected and self._powered and not self.suppressed(name, "suppress_contact_safety"):
            if not self.colliding[name]:
                self.log_event(f"{name}: {detected}, the arm pauses")
                drive.pause(self.now, COLLISION_PAUSE, self.position(drive))
            self.colliding[name] = detected

    def _board_requests(self) -> list[BoardRequest] | None:
        """What each limb requests of its boards; None without power."""
        if not self._powered:
            return None
        return [
            BoardRequest(
                drive,
                assisted=not self.suppressed(name, "suppress_gravity_compensation"),
                kept_off=not self.suppressed(name, "suppress_collision_avoidance"),
            )
            for name, drive in self.limbs.items()
        ]

    def suppressed(self, limb: str, what: str) -> bool:
        """Says whether a safety function of a limb is switched off now."""
        return self.suppressions[limb].active(what, self.now)
