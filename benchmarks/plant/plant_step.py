# SPDX-License-Identifier: BSD-3-Clause
"""Times the plant against pinocchio's articulated-body algorithm and against the clock.

Blocks of the cases alternate in one run, so that load on the machine falls on all of them; the medians'
ratio is the number to quote. Run from the repository: ``python -m benchmarks.plant.plant_step``.
"""

from __future__ import annotations

import gc
import random
import statistics
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin

from impedance_modules.effects.catalogue import CATALOGUE
from impedance_modules.effects.plant_builder import PlantBuilder, PlantEffects
from impedance_modules.plant.plant import Plant, PlantOptions
from impedance_modules.plant.rigid_object import ObjectBody
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.robot_reader import read_robot
from impedance_modules.spec.task import ObjectSpec, SurfaceSpec

BLOCK, BLOCKS = 40, 60
PERIOD = 1e-3
ARM = {"s0": 0.0, "s1": -0.4, "e0": 0.0, "e1": 1.2, "w0": 0.0, "w1": 0.7, "w2": 0.0}
BOX = ObjectSpec(("right", "left"), "box", 1.2, (0.3, 0.2, 0.2), None, "weld", None, 15.0, True)


def friction(model: RobotModel) -> PlantEffects:
    """Dry friction on every motor, asked for at every stage of a step."""
    builder = PlantBuilder(model)
    CATALOGUE["coulomb_friction"].apply_to_plant(
        builder, "actuator", {j: {"fc": 0.5} for j in model.joint_names}
    )
    return builder.finish()


def build(
    model: RobotModel, held: bool, surface: str | None, worn: PlantEffects | None = None
) -> tuple[Plant, np.ndarray]:
    """A plant at rest, and the torque that presses its object on the surface."""
    q = model.position({"right": {**ARM, "s0": 0.6}, "left": {**ARM, "s0": -0.6}})
    height = float(model.pose(q, model.limbs["right"].hand).translation[2]) - 0.1
    numbers = {"stiffness": 20000.0, "damping": 50.0, "friction": 0.3, "rotation": (0.0, 0.0, 0.0)}
    surfaces = {
        None: [],
        "plane": [SurfaceSpec("plane", height=height, position=None, size=None, **numbers)],
        "box": [
            SurfaceSpec("box", height=None, position=(0.9, 0.0, height - 0.1), size=(1, 2, 0.2), **numbers)
        ],
    }[surface]
    held_object = ObjectBody.of_task(model, BOX) if held else None
    plant = Plant(model, surfaces, held_object, PlantOptions(rate=1.0 / PERIOD, seed=0), worn)
    plant.warm(q)
    push = np.zeros(model.n)
    data = model.pin_model.createData()
    for limb in model.limbs.values():
        index = model.frame_id(limb.hand)
        axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        push += pin.computeFrameJacobian(model.pin_model, data, q, index, axes).T @ [
            0,
            0,
            -10.0 * held,
            0,
            0,
            0,
        ]
    return plant, push + plant.start_command


def case(plant: Plant, command: np.ndarray) -> Callable[[], None]:
    """One control period: sense, a light spring to the start, advance."""
    start = plant.position

    def period() -> None:
        state = plant.sense()
        plant.advance(command + 20.0 * (start - state.position) - state.velocity)

    return period


def main() -> None:
    """Prints medians [us], ratios to one pin.aba, and how much faster than the clock the plant runs."""
    model = RobotModel(read_robot(Path(__file__).parents[2] / "robots" / "baxter"))
    data, rng = model.pin_model.createData(), np.random.default_rng(0)
    q, v, tau = rng.normal(size=(3, model.n))
    cases: dict[str, Callable[[], None]] = {"pin.aba": lambda: pin.aba(model.pin_model, data, q, v, tau)}
    plants = {
        "free arms": build(model, held=False, surface=None),
        "free arms with friction": build(model, held=False, surface=None, worn=friction(model)),
        "box in both hands": build(model, held=True, surface=None),
        "box pressed on a plane": build(model, held=True, surface="plane"),
        "box pressed on a box": build(model, held=True, surface="box"),
    }
    cases |= {name: case(*parts) for name, parts in plants.items()}
    times: dict[str, list[float]] = {name: [] for name in cases}
    gc.freeze()
    gc.disable()
    order = list(cases)
    for _ in range(BLOCKS):
        random.shuffle(order)
        for name in order:
            run = cases[name]
            for _ in range(BLOCK):
                begin = time.perf_counter()
                run()
                times[name].append(time.perf_counter() - begin)
    report(times, plants)


def report(times: dict[str, list[float]], plants: dict[str, tuple[Plant, np.ndarray]]) -> None:
    """Prints one line per case."""
    unit = statistics.median(times["pin.aba"])
    heading = "one control period of 1 ms"
    print(f"{heading:26}   median       p99  x aba  x real time, median and mean  pressed")
    for name, values in times.items():
        middle, late = statistics.median(values), float(np.percentile(values, 99))
        pace = f"{PERIOD / middle:8.1f} {PERIOD / statistics.mean(values):6.1f}"
        faster = "" if name == "pin.aba" else f"{pace:29}"
        pressed = ""
        if name in plants and plants[name][0].object_pose is not None:
            pressed = f"{plants[name][0].contact_wrench('object')[2]:.1f} N"
        print(f"{name:26} {middle * 1e6:6.1f}us {late * 1e6:7.1f}us {middle / unit:6.1f} {faster} {pressed}")


if __name__ == "__main__":
    main()
