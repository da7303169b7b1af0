# SPDX-License-Identifier: BSD-3-Clause
"""The simulated Baxter without a network and without real time: a backend that reads the robot's messages directly.

Every ``read`` simulates one control period and merges the robot's messages, as the real backend does. So a run is
reproducible and as fast as the machine allows; it shows nothing about timing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from impedance_modules.backends.baxter.joint_states import JointStateMerger
from impedance_modules.backends.baxter.robot_link import SeaColumns
from impedance_modules.backends.baxter.ros import messages
from impedance_modules.backends.baxter.simulator.build_simulator import build_simulator
from impedance_modules.backends.baxter.simulator.joint_boards import CommandMode
from impedance_modules.backends.baxter.simulator.parameters import SPRINGS, TICK, SimulatorOptions
from impedance_modules.backends.baxter.simulator.publishers import MessageBuilder
from impedance_modules.backends.protocol import FirstState
from impedance_modules.control.assembly import Assembly
from impedance_modules.robot.state import RobotState
from impedance_modules.runs.execution import RunOptions, RunResult, carry_out
from impedance_modules.spec.patch_file import read_patch


class LockstepSimulator:
    """One simulator, and a backend that drives it."""

    def __init__(
        self,
        task: str,
        rate: float,
        effects: Path | None,
        seed: int,
        springs: Mapping[str, tuple[float, float]],
    ) -> None:
        patch = None if effects is None else read_patch(effects)
        options = SimulatorOptions(enabled=True, springs=springs, seed=seed)
        self.robot = build_simulator("baxter", task, patch, options).robot
        self._ticks = round(1.0 / (rate * TICK))
        self._readout = MessageBuilder(self.robot)
        self._merge = JointStateMerger(self.robot.model.joint_names)
        self._sea: dict[str, messages.SEAJointState] = {}
        self._hear_sea()
        self._extra = SeaColumns(self._sea)
        self._zero = 0.0
        self._plans: list[tuple[float, Callable[[], None]]] = []

    def when(self, seconds: float, act: Callable[[], None]) -> None:
        """Lets something happen at a time of the simulator's."""
        self._plans.append((seconds, act))

    def warm_up_with(self, cycle: Callable[[], None]) -> None:
        """Not needed: there is no waiting here."""

    def start(self) -> FirstState:
        self.write(np.zeros(self.robot.model.n))
        return self.newest()

    def newest(self) -> FirstState:
        state = self._live()
        self._zero = state.time
        return FirstState(self._shifted(state), np.zeros(self.robot.model.n))

    def read(self) -> RobotState:
        return self._shifted(self._live())

    def write(self, effort: np.ndarray) -> None:
        for name, drive in self.robot.limbs.items():
            values = effort[drive.limb.joints].tolist()
            self.robot.command(name, CommandMode.TORQUE, drive.limb.joint_names, values)

    def finish(self, how: str) -> None:
        for name, drive in self.robot.limbs.items():
            here = self.robot.position(drive).tolist()
            self.robot.command(name, CommandMode.POSITION, drive.limb.joint_names, here)

    def extra_columns(self) -> tuple[str, ...]:
        return self._extra.names

    def extra_values(self) -> np.ndarray:
        return self._extra.values()

    def _live(self) -> RobotState:
        for _ in range(self._ticks):
            for plan in [plan for plan in self._plans if plan[0] <= self.robot.now]:
                self._plans.remove(plan)
                plan[1]()
            self.robot.tick()
        now = round((1.0 + self.robot.now) * 1e9)
        self._hear_sea()
        sample = self._merge.take(self._readout.joint_states(now), self.robot.now)
        assert sample is not None
        return sample.state

    def _hear_sea(self) -> None:
        for limb in self.robot.model.limbs.values():
            self._sea[limb.name] = self._readout.sea_joints(limb, 0)

    def _shifted(self, state: RobotState) -> RobotState:
        return RobotState(state.time - self._zero, state.position, state.velocity, state.effort)


def run_in_lockstep(
    assembly: Assembly,
    out: Path,
    *,
    effects: Path | None = None,
    seed: int = 0,
    springs: Mapping[str, tuple[float, float]] = SPRINGS,
    prepare: Callable[[LockstepSimulator], None] = lambda simulator: None,
) -> tuple[RunResult, LockstepSimulator]:
    """Carries a task out on a simulated Baxter with effects that neither task nor model know."""
    simulator = LockstepSimulator(str(assembly.task.path), assembly.rate, effects, seed, springs)
    prepare(simulator)
    # "sim": time is simulated, the loop does not wait.
    options = RunOptions(out=out, seed=seed, duration=None, live=False, read_only=False, backend="sim")
    return carry_out(assembly, simulator, options, lambda time, phase: None), simulator
