# SPDX-License-Identifier: BSD-3-Clause
"""Compensation in the loop: the claim at the plant's motors, nothing where nothing is diagnosed, and what it mends."""

from pathlib import Path

import numpy as np
import pytest

from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.control.loop import Interrupt, run_loop
from impedance_modules.control.supervisor import Supervisor
from impedance_modules.runs.task_plant import sim_backend
from tests.control.test_passivity_on_the_plant import check_books, run_in_world
from tests.support.effect_recordings import AppliedEffect, applied, write_patch
from tests.support.swaying_arm import swaying

WORLDS = [
    {"seed": 31, "tank": 0.3},
    {"seed": 32, "rate": 500.0, "tank": 0.6, "push": 12.0},
    {"seed": 33, "noise": False, "tank": 0.2, "force": -20.0},
]

EVERYTHING = (
    applied("payload", "link", "right_hand", m=1.0, cx=0.0, cy=0.0, cz=0.1),
    applied("base_tilt", "link", "base", rx=0.1, ry=-0.1),
    applied("torque_offset", "link", "right_s0", c=2.0),
    applied("bench_spring", "contact", "left_e1", k=8.0, q0=0.2),
    applied("coulomb_friction", "actuator", "right_e1", fc=1.5),
    applied("viscous_friction", "actuator", "left_s0", fv=2.0),
    applied("load_dependent_friction", "actuator", "right_s1", kl=0.1),
)


def patch(folder: Path, *effects: AppliedEffect) -> Path:
    return write_patch(folder, *(effect.entry() for effect in effects), robot="baxter")


@pytest.mark.parametrize("world", WORLDS, ids=lambda world: f"seed{world['seed']}")
def test_work_at_the_motors_stays_within_the_claim(tmp_path: Path, world: dict) -> None:
    """None of the effects is there: what would take them back pushes the arms about, and the tank answers for it."""
    seen = run_in_world(tmp_path, **world, compensate=patch(tmp_path, *EVERYTHING))
    tank = seen.supervisor.controller.tank
    assert seen.cycles > 50
    assert tank.initial_energy > tank.initial + 1.0, "the potential at the start is part of the claim"
    check_books(seen)


TASK = swaying(initial=5, most=20, amplitude=0.08, seconds=2.5)


class Ran:
    """A run on the plant without noise: torques, and how far the hand was from where a run without effects has it."""

    def __init__(self, assembly: Assembly) -> None:
        supervisor, backend = Supervisor(assembly), sim_backend(assembly, seed=0, noise=False)
        first = backend.start()
        supervisor.start(first)
        self.efforts: list[np.ndarray] = []
        self.hand: list[np.ndarray] = []
        self.tank = supervisor.controller.tank

        def on_cycle(_state: object, effort: np.ndarray, _late: bool, _asked: bool) -> None:
            self.efforts.append(effort.copy())
            self.hand.append(backend.plant.pose("right_hand").translation.copy())

        timing = {"duration": None, "paced": False, "read_only": False}
        run_loop(supervisor, backend, first.state, on_cycle, Interrupt(), **timing)
        self.ending = supervisor.ending

    def apart(self, other: "Ran") -> float:
        return float(np.sqrt(np.mean((np.array(self.hand) - np.array(other.hand)) ** 2)))


def ran(folder: Path, effects: Path | None = None, compensate: Path | None = None) -> Ran:
    task = folder / "sway.yaml"
    task.write_text(TASK)
    options = {"rate": 500.0, "scale": 1.0, "arm": None}
    return Ran(assemble(str(task), effects=effects, compensate=compensate, **options))


def test_a_patch_without_size_changes_no_bit(tmp_path: Path) -> None:
    nothing = patch(
        tmp_path,
        applied("payload", "link", "right_hand", m=0.0, cx=0.0, cy=0.0, cz=0.0),
        applied("torque_offset", "link", "right_s0", c=0.0),
        applied("bench_spring", "contact", "right_e1", k=0.0, q0=0.0),
        applied("coulomb_friction", "actuator", "right_e1", fc=0.0),
        applied("torque_gain", "actuator", "right_s1", s=1.0),
    )
    plain, compensated = ran(tmp_path), ran(tmp_path, compensate=nothing)
    np.testing.assert_array_equal(plain.efforts, compensated.efforts)
    assert plain.tank.level == compensated.tank.level


MENDED = {
    "payload": (applied("payload", "link", "right_hand", m=0.6, cx=0.0, cy=0.0, cz=0.0), 0.35),
    "base_tilt": (applied("base_tilt", "link", "base", rx=0.02, ry=0.02), 0.2),
    "torque_offset": (applied("torque_offset", "link", "right_s1", c=2.5), 0.2),
    "bench_spring": (applied("bench_spring", "contact", "right_s0", k=8.0, q0=0.2), 0.2),
    "coulomb_friction": (applied("coulomb_friction", "actuator", "right_s0", fc=2.0), 0.65),
    "torque_gain": (applied("torque_gain", "actuator", "right_s1", s=0.85), 0.3),
}
"""Effect, and how much of the distance from the run without it may be left."""


@pytest.mark.parametrize("name", list(MENDED))
def test_what_is_compensated_brings_the_hand_back(tmp_path: Path, name: str) -> None:
    effect, left = MENDED[name]
    diagnosed = patch(tmp_path, effect)
    absent, before, after = ran(tmp_path), ran(tmp_path, diagnosed), ran(tmp_path, diagnosed, diagnosed)
    assert before.ending is not None and after.ending.value == before.ending.value == "done"
    assert before.apart(absent) > 3e-4
    assert after.apart(absent) < left * before.apart(absent)


def test_an_empty_tank_ends_what_overcomes_friction(tmp_path: Path) -> None:
    """Friction that is not there: the torque against it would drive the arm for ever, but the tank is what it has."""
    task = TASK.replace("initial: 5", "initial: 1.2").replace("duration: 2.5", "duration: 6")
    (tmp_path / "long.yaml").write_text(task)
    pushed = patch(tmp_path, applied("coulomb_friction", "actuator", "right_s0", fc=6.0))
    assembly = assemble(
        str(tmp_path / "long.yaml"), effects=None, compensate=pushed, rate=500.0, scale=1.0, arm=None
    )
    found = Ran(assembly)
    assert found.tank.level >= found.tank.floor - 1e-9
    assert found.tank.work <= found.tank.work_bound + 1e-9
