# SPDX-License-Identifier: BSD-3-Clause
"""Times the built-in plant with effects applied against the clock: two arms, 14 joints, each family of effects.

Blocks of all cases alternate in one run, in a random order, so that load on the machine falls on all of them. Printed
are times real time, as the median over blocks with the middle half of the blocks, and the ratio to the same plant
without effects. Run from the repository: ``python -m benchmarks.plant.effects_speed [BLOCKS]``.

``python -m benchmarks.plant.effects_speed --cold`` prints instead how long a new process takes to its first period,
without kept machine code, with it, and with it but another set of effects.
"""

from __future__ import annotations

import gc
import os
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.plant.plant_step import case
from impedance_modules.effects.apply import apply_patch, apply_to_plant
from impedance_modules.plant.plant import Plant, PlantOptions
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.document import parse_document
from impedance_modules.spec.patch_file import EffectSpec, PatchQuantity, PatchSpec
from impedance_modules.spec.robot_reader import read_robot
from impedance_modules.spec.robot_spec import RobotSpec

PERIOD, BLOCK, BLOCKS = 1e-3, 25, 40
ARM = {"s0": 0.6, "s1": -0.4, "e0": 0.0, "e1": 1.2, "w0": 0.0, "w1": 0.7, "w2": 0.0}

Numbers = dict[str, tuple[float, str]]
ON_JOINTS: dict[str, tuple[str, str, Numbers]] = {
    "Coulomb friction": ("coulomb_friction", "actuator", {"fc": (0.5, "N.m")}),
    "viscous friction": ("viscous_friction", "actuator", {"fv": (0.3, "N.m.s/rad")}),
    "Stribeck friction": (
        "stribeck_friction",
        "actuator",
        {"fc": (0.4, "N.m"), "fs": (0.6, "N.m"), "vs": (0.1, "rad/s")},
    ),
    "load-dependent friction": ("load_dependent_friction", "actuator", {"kl": (0.05, "1")}),
    "friction that drifts": (
        "friction_drift",
        "actuator",
        {"fv": (0.5, "N.m.s/rad"), "k": (0.3, "1"), "T": (30.0, "s")},
    ),
    "bristles (hysteresis)": ("hysteresis", "actuator", {"s0": (20.0, "N.m/rad"), "fc": (0.4, "N.m")}),
    "rotor inertia": ("reflected_inertia", "actuator", {"Ia": (0.2, "kg.m^2")}),
    "delay": ("command_delay", "timing", {"T": (0.004, "s")}),
    "lag": ("actuator_lag", "actuator", {"T": (0.01, "s")}),
    "saturation": ("torque_saturation", "actuator", {"limit": (30.0, "N.m")}),
    "controller gain": (
        "controller_gain",
        "actuator",
        {"dkp": (5.0, "N.m/rad"), "dkd": (0.1, "N.m.s/rad")},
    ),
    "backlash": ("backlash", "actuator", {"b": (0.002, "rad")}),
    "elasticity": ("joint_elasticity", "actuator", {"K": (900.0, "N.m/rad")}),
    "ripple": ("torque_ripple", "actuator", {"A": (0.2, "N.m"), "N": (40.0, "1"), "phi": (0.0, "rad")}),
    "parallel spring": ("parallel_spring", "link", {"k": (5.0, "N.m/rad"), "q0": (0.1, "rad")}),
    "encoder offset": ("encoder_offset", "sensor", {"dq0": (0.01, "rad")}),
}
"""Name -> effect, port and numbers of every joint."""

BODY = {"m": (0.8, "kg"), "cx": (0.0, "m"), "cy": (0.02, "m"), "cz": (0.05, "m")}
DRAG = {name: (5.0, "N.s^2/m^2") for name in ("dx", "dy", "dz")} | {n: BODY[n] for n in ("cx", "cy", "cz")}
PUSH = {name: (3.0, "N") for name in ("fx", "fy", "fz")} | {"start": (0.0, "s"), "end": (1e6, "s")}
ON_KEYS: dict[str, tuple[str, str, tuple[str, ...], Numbers]] = {
    "payload": ("payload", "link", ("right_hand",), BODY),
    "buoyancy": ("buoyancy", "link", ("right_hand",), BODY),
    "drag of water": ("fluid_drag", "link", ("right_hand", "left_hand"), DRAG),
    "push on a link": ("external_contact", "contact", ("right_hand",), PUSH),
    "crosstalk of drives": ("crosstalk", "actuator", ("right_w0<-right_w1",), {"c": (0.05, "1")}),
    "coupled motors": (
        "transmission_coupling",
        "actuator",
        ("right_w0<-right_w1",),
        {"Ia": (0.01, "kg.m^2"), "fv": (0.1, "N.m.s/rad"), "fc": (0.1, "N.m")},
    ),
}
"""Name -> effect, port, keys and numbers of each of them."""

TOGETHER = {
    "friction, inertia, ripple": ("Coulomb friction", "viscous friction", "rotor inertia", "ripple"),
    "delay, lag, saturation": ("delay", "lag", "saturation"),
    "ten effects": (
        "Stribeck friction", "viscous friction", "bristles (hysteresis)", "delay", "lag", "ripple",
        "parallel spring", "payload", "drag of water", "coupled motors",
    ),
}  # fmt: skip


def entry(robot: RobotSpec, name: str) -> EffectSpec:
    """One effect as a patch has it, on every joint or on its keys."""
    if name in ON_JOINTS:
        effect, port, numbers = ON_JOINTS[name]
        keys: tuple[str, ...] = tuple(robot.joints)
    else:
        effect, port, keys, numbers = ON_KEYS[name]
    joints = tuple(key.partition("<-")[0] for key in keys if key.partition("<-")[0] in robot.joints)
    written = {symbol: PatchQuantity(value, unit, None) for symbol, (value, unit) in numbers.items()}
    return EffectSpec(effect, joints, port, dict.fromkeys(keys, written), {})


def plant_with(names: tuple[str, ...]) -> tuple[Plant, np.ndarray]:
    """Baxter's two arms with effects, at rest, and the torque that keeps them there."""
    robot = read_robot(Path(__file__).parents[2] / "robots" / "baxter")
    entries = tuple(entry(robot, name) for name in names)
    patch = PatchSpec(robot.name, entries, parse_document(Path("patch.yaml"), "format: 1\n"))
    model = RobotModel(apply_patch(robot, patch))
    plant = Plant(model, [], None, PlantOptions(1.0 / PERIOD, seed=0), apply_to_plant(model, patch))
    q = model.position({"right": ARM, "left": {**ARM, "s0": -ARM["s0"]}})
    plant.warm(q)
    return plant, plant.start_command


def main(blocks: int) -> None:
    """Prints one line per case."""
    cases: dict[str, tuple[str, ...]] = {"no effect": ()}
    cases |= {name: (name,) for name in (*ON_JOINTS, *ON_KEYS)} | TOGETHER
    plants = {name: plant_with(names) for name, names in cases.items()}
    periods = {name: case(*parts) for name, parts in plants.items()}
    times: dict[str, list[float]] = {name: [] for name in cases}
    gc.freeze()
    gc.disable()
    order = list(cases)
    for _ in range(blocks):
        random.shuffle(order)
        for name in order:
            times[name].append(seconds_of_a_period(periods[name]))
    print(f"two arms, 14 joints, period 1 ms; {blocks} blocks of {BLOCK} periods")
    print(f"{'':28} steps  x real time (middle half)  x no effect")
    usual = np.median(times["no effect"])
    for name, values in times.items():
        low, middle, high = (float(t) for t in np.percentile(values, (75, 50, 25)))
        division = plants[name][0].division
        pace = f"{PERIOD / middle:6.1f}  ({PERIOD / low:5.1f} to {PERIOD / high:5.1f})"
        print(f"{name:28} {division.loops * division.steps:5d}  {pace:26} {middle / usual:8.2f}")


def seconds_of_a_period(period: Callable[[], None]) -> float:
    """Processor time of one period, the mean of a block [s]: what others do on the machine is not counted."""
    begin = time.process_time()
    for _ in range(BLOCK):
        period()
    return (time.process_time() - begin) / BLOCK


FIRST = "import sys; from benchmarks.plant.effects_speed import plant_with; plant_with(tuple(sys.argv[1:]))"


def cold() -> None:
    """Prints processor times of new processes to their first period."""
    sets = ((), (), ("Coulomb friction",), ("Coulomb friction",), ("delay", "lag"), TOGETHER["ten effects"])
    with tempfile.TemporaryDirectory() as folder:
        for names in sets:
            environment = {**os.environ, "NUMBA_CACHE_DIR": folder}
            before = os.times()
            subprocess.run([sys.executable, "-c", FIRST, *names], env=environment, check=True)
            after = os.times()
            spent = (
                after.children_user + after.children_system - before.children_user - before.children_system
            )
            print(f"{spent:6.1f} s  {', '.join(names) or 'no effect'}")


if __name__ == "__main__":
    if "--cold" in sys.argv:
        cold()
    else:
        main(int(sys.argv[1]) if len(sys.argv) > 1 else BLOCKS)
