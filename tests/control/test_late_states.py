# SPDX-License-Identifier: BSD-3-Clause
"""States that come late, are overtaken by the next, or are lost: the books stay true, and lateness costs nothing."""

from copy import deepcopy
from pathlib import Path

import numpy as np
import pytest

from impedance_modules.backends.sim_backend import SimBackend
from impedance_modules.control.assembly import assemble
from impedance_modules.control.controller import Controller
from impedance_modules.control.loop import Interrupt, run_loop
from impedance_modules.control.supervisor import Ending, Supervisor
from impedance_modules.robot.state import RobotState
from impedance_modules.runs.task_plant import sim_backend
from impedance_modules.safety.tank import Tank, measure
from tests.control.test_passivity_on_the_plant import ROUNDING, check_books, run_in_world
from tests.support.adversity import Books, UnreliableRobot
from tests.support.tank_worlds import Wire, filled_tank, limited, settings_of


def run_unreliably(folder: Path, seed: int, shares: dict, **world) -> tuple[Books, dict[str, int]]:
    """The books, and how many states were late, overtaken and lost."""
    robots: list[UnreliableRobot] = []

    def between(robot: SimBackend) -> UnreliableRobot:
        robots.append(UnreliableRobot(robot, seed, **shares))
        return robots[0]

    return run_in_world(folder, seed, **world, between=between), robots[0].seen


WORLDS = [
    {"seed": 41, "tank": 1.0},
    {"seed": 42, "rate": 500.0, "tank": 2.0},
    {"seed": 45, "noise": False, "rate": 500.0, "tank": 4.0},
    {"seed": 44, "noise": False, "push": 12.0, "tank": 2.0},
]


@pytest.mark.parametrize("world", WORLDS, ids=lambda world: f"seed{world['seed']}")
def test_the_claim_holds_for_late_overtaken_and_lost_states(tmp_path: Path, world: dict) -> None:
    shares = {"late": 0.1, "overtaken": 0.05, "lost": 0.05}
    found, counts = run_unreliably(tmp_path, shares=shares, **world)
    assert found.cycles > 100
    assert min(counts.values()) > 5
    check_books(found)


def test_without_the_robots_clock_the_books_are_wrong(tmp_path: Path, monkeypatch) -> None:
    world = {"noise": False, "rate": 500.0, "tank": 4.0, "shares": {"overtaken": 0.2}}
    right, _ = run_unreliably(tmp_path, 53, **world)
    assert right.largest_error <= ROUNDING
    monkeypatch.setattr(Controller, "reckon", lambda *arguments, **options: None)
    wrong, _ = run_unreliably(tmp_path, 53, **world)
    assert wrong.largest_error > 1e-2


@pytest.mark.parametrize("delay", [0, 1, 2])
def test_a_late_torque_that_is_sent_steals_and_a_repeated_one_does_not(delay: int) -> None:
    """The rotor runs along whatever acts; every second state is late, and a torque sent for it misses its period."""
    stolen = {}
    for repeats in (True, False):
        rigid = np.zeros(1)
        s = settings_of(1, delay=delay, compliance=rigid, initial=4.0, floor=0.1, hold=0.004)
        tank, wire, theta, true = filled_tank(s, rigid, rigid, 0.0), Wire(delay, 1), rigid, 0.0
        for cycle in range(400):
            if cycle:
                measure(tank, theta, np.zeros(1), 0.0)
            late, before = cycle % 2 == 1, (tank.pending[-2] if delay else tank.applied).copy()
            command = limited(tank, np.array([-5.0 if late else 5.0]))
            if late and repeats:
                tank.pending[-1] = before
            applied = wire.applied(None if late else command)
            step = s.speed_bound * s.period * np.sign(applied)
            theta, true = theta + step, true + float(applied @ step)
        stolen[repeats] = true - (s.initial - s.floor)
    assert stolen[True] <= 1e-9
    assert stolen[False] > 1.0


def tank_after(task: str, late: float, seconds: float) -> Tank:
    """The tank after so much of a shipped task, a share of whose states come late."""
    assembly = assemble(task, effects=None, rate=200.0, scale=1.0, arm=None)
    supervisor, robot = Supervisor(assembly), UnreliableRobot(sim_backend(assembly, 1), 1, late=late)
    first = robot.start()
    supervisor.start(first)
    tanks: list[Tank] = []

    def watch(state: RobotState, effort: np.ndarray, late: bool, asked: bool) -> None:
        if not asked:
            assert supervisor.controller.cycle.admitted == 1.0
            tanks.append(deepcopy(supervisor.controller.tank))

    options = {"duration": seconds, "paced": False, "read_only": False}
    run_loop(supervisor, robot, first.state, watch, Interrupt(), **options)
    assert supervisor.ending is Ending.INTERRUPTED
    assert robot.seen["late"] >= 0.8 * late * seconds * 200.0
    return tanks[-1]


@pytest.mark.parametrize("task", ["elbow-swing", "hand-over-hand"])
def test_late_states_do_not_starve_a_shipped_tank(task: str) -> None:
    punctual, late = (tank_after(task, share, 2.5) for share in (0.0, 0.2))
    assert late.assumed == 0.0
    assert abs(late.work - punctual.work) < 0.1
