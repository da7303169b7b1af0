# SPDX-License-Identifier: BSD-3-Clause
"""Stops from random states inside the limits, on a plant that may differ from the model: does the motion calm?"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

from impedance_modules.backends.protocol import FirstState
from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.control.supervisor import Supervisor
from impedance_modules.effects.plant_builder import PlantEffects
from impedance_modules.plant.plant import Plant, PlantOptions
from tests.support.forecast_tasks import SOFT_HANDS

TASK = f"""
format: 1
name: stops
robot: baxter
{SOFT_HANDS}\
safety: {{tank: {{initial: 5, max: 10, floor: 0.5}}}}
phases: [{{name: hold, duration: 5}}]
"""

HOLD = 1.5
"""Of the robot's own mode after the brake [s]."""

STOP_BUDGET = 0.05
"""What a stop may add to the energy in spite of all: sensors see positions on a grid and with noise [J]."""

CALM_TIME = 2.0
"""From the stop's begin until less than 1 % of the energy is left: at most 0.5 s of braking, then the hold [s]."""

PULSE = 0.1
"""Largest torque that is still under way when the stop begins, as part of the limit."""


@dataclass(frozen=True)
class Difference:
    """One effect with one number that is drawn anew for every joint or body.

    Attributes:
        effect, port, symbol, unit: As in a patch.
        low, high: Its range.
        bodies: What the numbers belong to; every joint where there are none.
        others: Further symbols and units, all zero.
    """

    effect: str
    port: str
    symbol: str
    unit: str
    low: float
    high: float
    bodies: tuple[str, ...] = ()
    others: tuple[tuple[str, str], ...] = ()

    def entry(self, joints: tuple[str, ...], random: np.random.Generator) -> dict[str, object]:
        """An effect of a patch, its numbers drawn."""
        zeros = {symbol: {"value": 0.0, "unit": unit} for symbol, unit in self.others}
        numbers = {
            key: {
                self.symbol: {"value": float(random.uniform(self.low, self.high)), "unit": self.unit},
                **zeros,
            }
            for key in self.bodies or joints
        }
        return {"effect": self.effect, "joints": list(joints), "port": self.port, "parameters": numbers}


HANDS, CENTRE = ("right_hand", "left_hand"), (("cx", "m"), ("cy", "m"), ("cz", "m"))

DIFFERENCES = {
    "delay": Difference("command_delay", "timing", "T", "s", 0.0, 0.02),
    "lag": Difference("actuator_lag", "actuator", "T", "s", 0.0, 0.02),
    "backlash": Difference("backlash", "actuator", "b", "rad", 0.0, 0.02),
    "motor gain": Difference("torque_gain", "actuator", "s", "1", 0.3, 1.8),
    "sensor gain": Difference("torque_gain", "sensor", "s", "1", 0.3, 1.8),
    "lag of velocity": Difference("velocity_filter_lag", "sensor", "T", "s", 0.0, 0.05),
    "payload": Difference("payload", "link", "m", "kg", 0.0, 2.0, HANDS, CENTRE),
    "tilt": Difference("base_tilt", "link", "rx", "rad", -0.1, 0.1, ("base",), (("ry", "rad"),)),
    "torque offset": Difference("torque_offset", "actuator", "c", "N.m", -2.0, 2.0),
}


@dataclass(frozen=True)
class Stop:
    """What a stop did.

    Attributes:
        start: Kinetic and spring energy when the torques under way had ended [J].
        rise: How far it rose above that at most [J].
        left: Part of it that was left at the end of the hold.
        seconds: From the stop's begin until it stayed below 1 % of ``start`` or ``FLOOR`` [s].
        speed: Largest motor speed afterwards over the declared one.
        travel: Of the joint that moved farthest until the end of the hold [rad].
        speed_before: The same at the stop's begin.
        reason: The supervisor's.
    """

    start: float
    rise: float
    left: float
    seconds: float
    speed: float
    travel: float
    speed_before: float
    reason: str


FLOOR = 0.005
"""Energy below which a robot counts as calm, however little there was [J]."""


def write_task(folder: Path) -> Path:
    """Writes a task whose arms are free to move."""
    path = folder / "stops.yaml"
    path.write_text(TASK)
    return path


def write_patch(
    folder: Path, joints: tuple[str, ...], names: tuple[str, ...], random: np.random.Generator
) -> Path:
    """Writes a patch with these differences, drawn for every joint."""
    effects = [DIFFERENCES[name].entry(joints, random) for name in names]
    path = folder / "patch.yaml"
    provenance = {"origin": "hand", "date": "2026-11-22", "note": "A difference that the stop does not know."}
    content = {"format": 1, "robot": "baxter", "provenance": provenance, "effects": effects}
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    return path


WEIGHTLESS, EARTH = (0.0, 0.0, 0.0), (0.0, 0.0, -9.81)
"""Without weight, the robot carries it exactly, whatever its motors' gain [m/s^2]."""


def plant_of(
    assembly: Assembly,
    effects: PlantEffects | None,
    seed: int,
    gravity: tuple[float, float, float] = WEIGHTLESS,
) -> Plant:
    """The plant of an assembly's robot, in free space."""
    options = PlantOptions(rate=assembly.rate, seed=seed, gravity=gravity)
    return Plant(assembly.model, (), None, options, effects)


def stop_from_random_state(assembly: Assembly, plant: Plant, random: np.random.Generator) -> Stop:
    """Sets the plant moving, stops it through the supervisor, and watches until the end of the hold."""
    delay = _set_moving(assembly, plant, random)
    supervisor = Supervisor(assembly)
    top = assembly.limits.velocity_max
    before = float(np.max(np.abs(plant.motor_velocity) / top))
    state = plant.sense()
    supervisor.start(FirstState(state, np.zeros(assembly.model.n)))
    energies, speeds, began = [_moving_energy(plant)], [before], plant.state.start.position.copy()

    def advance(effort: np.ndarray | None) -> None:
        plant.advance(effort)
        energies.append(_moving_energy(plant))
        speeds.append(float(np.max(np.abs(plant.motor_velocity) / top)))

    while supervisor.ending is None:
        advance(supervisor.step(state, late=False, stop_request="a test asks for it"))
        state = plant.sense()
    plant.hold()
    for _ in range(round(HOLD * assembly.rate)):
        advance(None)
    travel = float(np.max(np.abs(plant.state.start.position - began)))
    return _judged(np.array(energies), speeds, travel, delay + 1, assembly.period, supervisor.reason)


def _set_moving(assembly: Assembly, plant: Plant, random: np.random.Generator) -> int:
    """Gives every joint a position and a speed inside its limits, and torques under way; returns the delay."""
    low, high = assembly.limits.position_min, assembly.limits.position_max
    middle, reach = 0.5 * (low + high), 0.5 * (high - low)
    plant.reset(middle + 0.95 * reach * random.uniform(-1.0, 1.0, assembly.model.n))
    speed = random.uniform(-0.9, 0.9, assembly.model.n) * assembly.limits.velocity_max
    plant.state.start.velocity[:] = speed
    plant.state.start.motor_velocity[:] = speed
    plant._sensors._readings.velocity[:] = plant._sensors._readings.estimate[:] = speed
    for _ in range(plant.delay + 1):
        plant.advance(PULSE * random.uniform(-1.0, 1.0, assembly.model.n) * assembly.limits.effort_max)
    return plant.delay


def _moving_energy(plant: Plant) -> float:
    book = plant.energy()
    return book.kinetic + book.springs + book.stops


def _judged(
    energies: np.ndarray, speeds: list[float], travel: float, first: int, period: float, reason: str
) -> Stop:
    after = energies[first:]
    start = float(after[0])
    loud = np.flatnonzero(after > max(0.01 * start, FLOOR))
    return Stop(
        start=start,
        rise=float(after.max() - start),
        left=float(after[-1] / start),
        seconds=period * (first + (int(loud[-1]) + 1 if loud.size else 0)),
        speed=max(speeds[first:]),
        travel=travel,
        speed_before=speeds[0],
        reason=reason,
    )


def assembly_at(folder: Path, rate: float, *, patch: Path | None = None) -> Assembly:
    """The task of these tests at a control rate [Hz]; with a patch, the controller knows of it."""
    return assemble(str(write_task(folder)), effects=patch, rate=rate, scale=1.0, arm=None)
