# SPDX-License-Identifier: BSD-3-Clause
"""The simulated robot with its surroundings: takes a torque command per period, reports what it senses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from impedance_modules.effects.joint_motion import JointTorque
from impedance_modules.effects.plant_builder import PlantBuilder, PlantEffects
from impedance_modules.errors import BadInput, NotConnected
from impedance_modules.plant.energy_balance import EnergyBook
from impedance_modules.plant.finite_state import refuse_non_finite
from impedance_modules.plant.ground_truth import OBJECT, GroundTruth
from impedance_modules.plant.initial_state import StartAtRest, build_plant_state
from impedance_modules.plant.integrator import Integrator
from impedance_modules.plant.joints import IDEAL, hold_gains, motor_positions
from impedance_modules.plant.links import link_model
from impedance_modules.plant.motor_commands import (
    CommandQueue,
    Mode,
    Order,
    WeightCompensation,
    checked_effort,
)
from impedance_modules.plant.plant_state import WORK_SIZE, StateVector
from impedance_modules.plant.point_contact import SurfaceDistances
from impedance_modules.plant.pushes import Pushes
from impedance_modules.plant.rigid_object import ObjectBody
from impedance_modules.plant.sensors import Sensors
from impedance_modules.plant.step_stability import SHORTEST_STEP, refuse_step, stable_step
from impedance_modules.plant.torque_feedback import TorqueFeedback
from impedance_modules.records import Vector
from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.state import RobotState
from impedance_modules.spec.robot_spec import ROBOT_LOOP_PERIOD, UPRIGHT_GRAVITY
from impedance_modules.spec.task import PushSpec, SurfaceSpec


@dataclass(frozen=True)
class PlantOptions:
    """How the plant is stepped.

    Attributes:
        rate: Of the control cycle: one ``advance`` lasts 1 / rate [Hz].
        seed: Of the sensor noise; the same seed gives the same run, bit by bit.
        noise: Sensor noise as the robot file declares it; False switches it off.
        step: Longest integration step [s]; whole steps fill the robot's own loop.
        shortest_step: Down to which the plant divides it where its parts are too light or too stiff for it [s].
        gravity: Acceleration in world axes [m/s^2].
    """

    rate: float
    seed: int
    noise: bool = True
    step: float = 0.25e-3
    shortest_step: float = SHORTEST_STEP
    gravity: tuple[float, float, float] = UPRIGHT_GRAVITY

    def __post_init__(self) -> None:
        for name in ("rate", "step"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise BadInput(f"plant option {name} is {value}; valid: a finite number above 0")
        if not 0.0 < self.shortest_step <= self.step:
            raise BadInput(
                f"plant option shortest_step is {self.shortest_step}; valid: above 0, up to step, {self.step}"
            )


@dataclass(frozen=True)
class Division:
    """How a control period divides: ``loops`` loops of the robot, each of ``steps`` steps [s]."""

    loops: int
    steps: int
    step: float
    loop: float


def divide(options: PlantOptions) -> Division:
    """Divides the control period into the fewest loops of at most 1 ms, and those into whole steps."""
    period = 1.0 / options.rate
    loops = _whole(period / ROBOT_LOOP_PERIOD)
    steps = _whole(period / loops / options.step)
    return Division(loops, steps, period / (loops * steps), period / loops)


def _whole(ratio: float) -> int:
    """Rounds up, forgiving the last digits of a quotient that should be whole."""
    return max(1, math.ceil(ratio - 1e-9))


class Plant(GroundTruth):
    """Simulated reality for one robot, its surfaces and the object in its hands.

    Life: ``reset(q)``, then ``state = sense()``, ``advance(command)`` once per control period.
    ``hold`` and ``release`` are the robot's own modes; a torque command takes it out of them again.
    What really happens, beyond what the robot reports, is read from the ``GroundTruth`` it inherits.

    Attributes:
        model: The robot.
        division: How a control period divides into the robot's loops and integration steps.
        start_command: (n,) torque [N.m] that carries the start load; it acts before the first command.
    """

    def __init__(
        self,
        model: RobotModel,
        surfaces: Sequence[SurfaceSpec],
        held: ObjectBody | None,
        options: PlantOptions,
        effects: PlantEffects | None = None,
        *,
        pushes: Sequence[PushSpec] = (),
    ) -> None:
        """Builds the plant.

        Args:
            model: The robot.
            surfaces: Its surroundings.
            held: What its hands hold, or None.
            options: How it is stepped.
            effects: What reality does beyond the model (``apply_to_plant``); None for nothing.
            pushes: On hands or object, from outside.
        """
        self._effects = no_effects(model) if effects is None else effects
        gravity = self._effects.gravity_turn @ np.array(options.gravity)
        self._gravity = (float(gravity[0]), float(gravity[1]), float(gravity[2]))
        self.model = model
        self.division = divide(options)
        self._options = options
        self._timing = model.spec.timing
        frames = tuple(limb.hand for limb in model.limbs.values())
        links = link_model(model, gravity)
        state = build_plant_state(model, links, frames, surfaces, held, self._effects)
        state.joints["half_gap"] = 0.5 * self._effects.gap
        integrator = Integrator(
            links,
            state,
            distances=SurfaceDistances(surfaces, state.contacts),
            step=self.division.step,
            effects=self._effects.torques,
        )
        super().__init__(model, state, integrator, frames)
        self._pushes = Pushes(pushes, self._pushable())
        self._sensors = Sensors(model.spec.sensors, self._effects.sensors, self.division.loop, None)
        self._weight = WeightCompensation(model, self._effects, options.gravity)
        self._start = StartAtRest(integrator, held, self._effects, self._weight)
        self._assist = state.joints["assist"]
        inner = model.spec.inner_torque_loop
        self._inner_loop = None if inner is None else TorqueFeedback(inner, state)
        self._ideal = bool(np.any(state.joints["kind"] == IDEAL))
        self._encoders_at_motors = bool(model.encoder_at_motor.any())
        self._queue: CommandQueue | None = None
        self._standing: Order | None = None
        self._periods = 0
        self._before = self.state.start.whole.copy()
        self.start_command: Vector = np.zeros(model.n)

    @property
    def torques(self) -> list[JointTorque]:
        """Torques on the joints, by code of one's own that is called before each stage; append one before ``reset``.

        The effects of ``apply_to_plant`` are not among them, nor told of them at the start.
        """
        return self._integrator.torques

    @property
    def mode(self) -> Mode:
        """What the robot does in the present period."""
        return self._running().acting.mode

    @property
    def delay(self) -> int:
        """Whole periods from issuing a command to its acting."""
        return self._running().delay

    def reset(self, q: Vector) -> None:
        """Puts everything at rest at q (n,) [rad], all springs deflected by the weight they carry.

        The hands hold the object where it starts, pressing with the declared squeeze and carrying its
        weight if the task says that the arms do.

        Raises:
            BadInput: q has another length, or no integration step is short enough for this plant.
        """
        position = checked_effort(q, self.model.n)
        self.aim(position, np.zeros(self.model.n))
        self._rest(position)
        self.state.start.whole[-WORK_SIZE:] = 0.0
        self._start_robot()

    def refuse_start(self, q: Vector) -> None:
        """Puts everything at rest at q (n,) [rad] and refuses what ``reset`` would; leaves the plant unfit to run.

        Raises:
            BadInput: As in ``reset``.
        """
        self._start.rest(checked_effort(q, self.model.n))
        refuse_step(self._integrator, self._options.shortest_step)

    def _rest(self, position: Vector) -> None:
        """Puts everything at rest, with a step that is short enough for all of it."""
        self.division = divide(self._options)
        self._integrator.step = self.division.step
        self.start_command = self._start.rest(position)
        step = stable_step(self._integrator, self._options.shortest_step)
        if step < self.division.step:
            self.division = divide(replace(self._options, step=step, shortest_step=step))
            self._integrator.step = self.division.step
            self.start_command = self._start.rest(position)

    def _start_robot(self) -> None:
        """Starts sensors, command queue and clock."""
        source = np.random.default_rng(self._options.seed) if self._options.noise else None
        self._sensors = Sensors(self.model.spec.sensors, self._effects.sensors, self.division.loop, source)
        self._sensors.reset(self._at_encoders())
        start = Order(Mode.TORQUE, self.start_command.copy())
        timing = replace(self._timing, command_delay=self._effects.command_delay)
        self._queue = CommandQueue(timing, self._options.rate, start)
        self._standing = None
        self._periods = 0
        self._integrator.time = 0.0
        if self._inner_loop is not None:
            self._inner_loop.reset(self.division.loop)

    def _running(self) -> CommandQueue:
        if self._queue is None:
            raise NotConnected("the plant has not been reset: call reset(q) with a start posture first")
        return self._queue

    def sense(self) -> RobotState:
        """Reports what the robot measures now."""
        self._running()
        return self._sensors.sample(self.time, self.sensed_torque)

    def advance(self, command: Vector | None) -> None:
        """Advances by one control period.

        Args:
            command: (n,) torque [N.m] that acts, delayed, on top of what the robot adds by itself;
                None sends nothing: the last torque stays until the time-out, hold and release stay.

        Raises:
            PlantNotFinite: A number of the state is not finite; the plant must be reset.
        """
        queue = self._running()
        if command is not None:
            self._standing = None
            issued: Order | None = Order(Mode.TORQUE, checked_effort(command, self.model.n))
        else:
            issued = self._standing
        self._obey(queue.acting, queue.exchange(issued))
        for _ in range(self.division.loops):
            np.copyto(self._before, self.state.start.whole)
            self._robot_loop()
            # A sum of squares is finite only if every number is; beyond 1e154 the numbers are looked at one by one.
            if not math.isfinite(self.state.start.whole.dot(self.state.start.whole)):
                before = StateVector.over(self._before)
                refuse_non_finite(self.state.start, before, self.time, self.model.joint_names)
        self._periods += 1
        self._integrator.time = self._periods / self._options.rate

    def hold(self) -> None:
        """Orders the robot's own position mode: it keeps the joints where they are when this arrives."""
        self._standing = Order(Mode.HOLD, np.zeros(self.model.n))

    def release(self) -> None:
        """Orders zero torque: the robot carries only the arms' weight, if it does that at all."""
        self._standing = Order(Mode.RELEASE, np.zeros(self.model.n))

    def warm(self, q: Vector) -> None:
        """Compiles every path of a run, then stands reset at q; call before a loop with deadlines."""
        self.reset(q)
        self.sense()
        self.advance(np.zeros(self.model.n))
        self.reset(q)

    def _obey(self, before: Order, order: Order) -> None:
        """Sets the torques of the order that acts in this period."""
        if order is before:
            return
        joints = self.state.joints
        joints["command"] = order.effort
        if order.mode is not before.mode:
            joints["hold_stiffness"], joints["hold_damping"] = 0.0, 0.0
            if order.mode is Mode.HOLD:
                stiffness, damping = hold_gains(self.model, self._integrator.link_mobility())
                joints["hold_stiffness"], joints["hold_damping"] = stiffness, damping
                joints["hold_position"] = self.state.start.motor_position

    def _robot_loop(self) -> None:
        """Advances by one loop of the robot: its gravity compensation, pushes, the steps, its sensors."""
        if self._weight.acts or self._inner_loop is not None:
            carried = self._weight.torque(self._sensors.position)
            self._assist[:] = carried
            if self._inner_loop is not None:
                self._assist += self._inner_loop.added(carried)
        self._pushes.apply(self.state, self.time)
        if self._ideal:
            self._deflect_ideal_joints()
        self._integrator.advance(self.division.steps)
        self._sensors.update(self._at_encoders())

    def _at_encoders(self) -> Vector:
        """Gives the true positions (n,) where the encoders sit [rad]: the links', or the motors'."""
        return self.encoder_position if self._encoders_at_motors else self.state.start.position

    def _pushable(self) -> dict[str, int]:
        """Names the bodies that can be pushed, limbs and ``object``, with their rows of wrenches."""
        names = [*self.model.limbs, *([OBJECT] if self.state.body.present else [])]
        return {name: row for row, name in enumerate(names)}

    def aim(self, position: Vector, velocity: Vector) -> None:
        """Tells effects the joint motion (n,) [rad], [rad/s] that the controller aims at; at first the start posture.

        Only an effect that adds torque from the tracking error listens (``controller_gain``).
        """
        self._integrator.aim[:] = position
        self._integrator.aim_velocity[:] = velocity

    def _deflect_ideal_joints(self) -> None:
        """Adds the work of deflecting an ideal joint's spring to the counter: the new torque times theta's jump."""
        joints, before, after = self.state.joints, np.empty(self.model.n), np.empty(self.model.n)
        motor_positions(self.state, before)
        joints["motor"] = np.where(
            joints["kind"] == IDEAL, joints["command"] + joints["assist"], joints["motor"]
        )
        motor_positions(self.state, after)
        self.state.start.work["command_work"] += float(joints["command"] @ (after - before))

    def energy(self) -> EnergyBook:
        """Adds up every energy and work since ``reset`` [J]."""
        return self.energy_book(self._gravity)


def no_effects(model: RobotModel) -> PlantEffects:
    """Returns the effects of an empty patch."""
    return PlantBuilder(model).finish()
