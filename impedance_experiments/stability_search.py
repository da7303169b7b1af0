# SPDX-License-Identifier: BSD-3-Clause
"""A hand made stiffer until the loop on the plant is unstable: the search, and the predicted limit."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from impedance_experiments.task_run import watch_task
from impedance_modules.arrays import Array
from impedance_modules.control.assembly import Assembly
from impedance_modules.control.supervisor import Ending, Supervisor
from impedance_modules.errors import BadInput
from impedance_modules.modules.arms import build_modules
from impedance_modules.modules.damping import phase_damping
from impedance_modules.modules.equilibrium import start_equilibrium
from impedance_modules.plant.plant import Plant
from impedance_modules.prediction.loop_stability import forecast_stability
from impedance_modules.prediction.mechanism import Mechanism, Setting
from impedance_modules.prediction.statics import Loads, analyse_state, find_rest
from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.state import RobotState
from impedance_modules.spec.robot_spec import STANDARD_GRAVITY
from impedance_modules.spec.task import ArmSpec, PushSpec

BRACKET = 1.2
"""The limit is first searched within this factor of the prediction."""
WIDEST = 12
"""Times the bracket is widened before the search gives up."""
SMOOTHING = 0.1
"""Motion slower than this is the hand's own swinging, not the loop's ringing [s]."""
EARLY, LATE = (1.7, 1.95), (2.7, 2.95)
"""When ringing is measured [s]: a second after ``stiff-hand`` is knocked, the faster dying modes gone, and later."""
SMALL_HIT = 1e-3
"""Part of the task's knock with which small ringing is started."""
LEAST_OSCILLATION = 1e-7
"""Oscillation below this has decayed, whatever its initial size [rad/s]."""


@dataclass(frozen=True)
class Knock:
    """One knocked hand on the plant.

    Attributes:
        stiffness: Of its stiffest direction [N/m].
        time: (N,) [s].
        speed: (N,) fast part of the motors' speeds, all joints together [rad/s].
        kept: Ringing after one more second over ringing a second after the knock; infinite where it was stopped.
    """

    stiffness: float
    time: Array
    speed: Array
    kept: float

    @property
    def stable(self) -> bool:
        """Whether the ringing dies away."""
        return self.kept < 1.0


def stiffened(assembly: Assembly, factor: float) -> Assembly:
    """Multiplies the stiffness of all springs on frames; joint springs and all ratios stay."""

    def arm_of(arm: ArmSpec) -> ArmSpec:
        return replace(arm, springs=tuple(replace(s, stiffness=factor * s.stiffness) for s in arm.springs))

    arms = {name: arm_of(arm) for name, arm in assembly.task.arms.items()}
    task = replace(assembly.task, arms=arms)
    return replace(assembly, task=task, modules=build_modules(task, assembly.model))


def finely_sensed(assembly: Assembly) -> Assembly:
    """Takes the rounding out of a robot's sensors and makes the knock small; delay, sampling and filter stay.

    Rounded angles keep any loop with fast dampers oscillating slightly, and a torque that changes faster than the
    robot allows bounds any oscillation: both hide whether a small one decays or grows.
    """
    pushes = tuple(_gentle(push) for push in assembly.task.pushes)
    sensors = replace(assembly.robot.sensors, position_resolution=0.0, effort_resolution=0.0)
    robot = replace(assembly.robot, sensors=sensors)
    model = RobotModel(robot)
    task = replace(assembly.task, pushes=pushes)
    return replace(assembly, task=task, robot=robot, model=model, modules=build_modules(task, model))


def _gentle(push: PushSpec) -> PushSpec:
    x, y, z, rx, ry, rz = (SMALL_HIT * part for part in push.wrench)
    return replace(push, wrench=(x, y, z, rx, ry, rz))


def hand_stiffness(assembly: Assembly) -> float:
    """Gives the largest linear stiffness among the first arm's springs [N/m]."""
    springs = next(iter(assembly.task.arms.values())).springs
    return max(float(np.linalg.eigvalsh(spring.stiffness[:3, :3])[-1]) for spring in springs)


def predicted_limit(assembly: Assembly) -> float:
    """Gives the highest stable stiffness that ``check`` prints for the only arm of a task [N/m].

    Raises:
        BadInput: It is unstable however soft, or stable however stiff.
    """
    mechanism, modules = Mechanism(assembly), assembly.modules
    mechanism.update(modules.posture, np.zeros_like(modules.posture))
    setting = Setting(modules, start_equilibrium(modules), phase_damping(modules, mechanism.kinematics))
    arms = analyse_state(mechanism, setting, modules.posture).arms
    found = forecast_stability(assembly, modules, arms, None)[0]
    if not found.scale:
        raise BadInput(
            f"task '{assembly.task.name}': there is no stiffness at which its loop loses stability"
        )
    return found.scale * found.stiffness


def simulated_limit(assembly: Assembly, guess: float, halvings: int) -> tuple[Knock, Knock]:
    """Finds the last stable and the first unstable stiffness on the plant by bisection.

    Args:
        assembly: With a knock in its pushes.
        guess: Where to begin [N/m].
        halvings: Of the interval's logarithm, after a bracket has been found.
    """
    own = hand_stiffness(assembly)

    def knock(stiffness: float) -> Knock:
        return knocked(stiffened(assembly, stiffness / own))

    low, high = knock(guess / BRACKET), knock(guess * BRACKET)
    for _ in range(WIDEST):
        if low.stable and not high.stable:
            break
        if not low.stable:
            low, high = knock(low.stiffness / BRACKET), low
        else:
            low, high = high, knock(high.stiffness * BRACKET)
    for _ in range(halvings):
        middle = knock(float(np.sqrt(low.stiffness * high.stiffness)))
        low, high = (middle, high) if middle.stable else (low, middle)
    return low, high


def knocked(assembly: Assembly) -> Knock:
    """Runs a task with a knock on the plant, without noise, and measures how its motors ring."""
    rows: list[tuple[float, Array]] = []

    def observe(_: RobotState, plant: Plant, __: Supervisor) -> None:
        rows.append((plant.time, plant.motor_velocity))

    supervisor = watch_task(assembly, observe, noise=False)
    time, speeds = np.array([row[0] for row in rows]), np.array([row[1] for row in rows])
    width = max(1, round(SMOOTHING * assembly.rate))
    window = np.ones(width) / width
    slow = np.stack([np.convolve(column, window, mode="same") for column in speeds.T], axis=1)
    # The mean over a window is none where the window reaches beyond the run.
    whole = slice(width // 2, time.size - (width - 1) // 2)
    time, fast = time[whole], np.linalg.norm(speeds - slow, axis=1)[whole]
    if supervisor.ending is not Ending.DONE:
        return Knock(hand_stiffness(assembly), time, fast, np.inf)
    first, last = (_rms(fast[(time >= a) & (time < b)]) for a, b in (EARLY, LATE))
    kept = 0.0 if last < LEAST_OSCILLATION else last / first
    return Knock(hand_stiffness(assembly), time, fast, kept)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def hand_drift(assembly: Assembly, stiffness: float, seed: int) -> tuple[float, float]:
    """Lets a hand sink under what the robot does not carry: on the plant, and by the statics [m].

    Args:
        assembly: With a payload in its patch.
        stiffness: Of the hand's spring in its stiffest direction [N/m].
        seed: Of the simulated noise.
    """
    soft = stiffened(assembly, stiffness / hand_stiffness(assembly))
    limb = next(iter(soft.task.arms))
    hand = soft.model.limbs[limb].hand
    heights: list[float] = []

    def observe(_: RobotState, plant: Plant, __: Supervisor) -> None:
        heights.append(float(plant.pose(hand).translation[2]))

    watch_task(soft, observe, seed=seed)
    return heights[0] - heights[-1], heights[0] - _sunk_height(soft, hand)


def _sunk_height(assembly: Assembly, hand: str) -> float:
    """Gives the height at which a hand's springs carry what the robot does not [m]."""
    mechanism, modules = Mechanism(assembly), assembly.modules
    mechanism.update(modules.posture, np.zeros_like(modules.posture))
    setting = Setting(modules, start_equilibrium(modules), phase_damping(modules, mechanism.kinematics))
    weight = np.array([0.0, 0.0, -unknown_weight(assembly), 0.0, 0.0, 0.0])
    rest = find_rest(mechanism, setting, modules.posture, Loads({hand: weight}, surfaces=False))
    if rest is None:
        raise BadInput(f"task '{assembly.task.name}': the hand finds no rest under {-weight[2]:g} N")
    return float(assembly.model.pose(rest.q, hand).translation[2])


def unknown_weight(assembly: Assembly) -> float:
    """Adds up the weight of all payloads that the assembly's patch fixes to links [N]."""
    patch = assembly.patch
    masses = (
        []
        if patch is None
        else [
            parameters["m"].value
            for effect in patch.effects
            if effect.effect == "payload"
            for parameters in effect.parameters.values()
        ]
    )
    return STANDARD_GRAVITY * sum(masses)
