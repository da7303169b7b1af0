# SPDX-License-Identifier: BSD-3-Clause
"""A simulated state that is not finite ends the run with its reason, at any rate and moment; what was is kept."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from impedance_modules.backends.sim_backend import SimBackend
from impedance_modules.control.assembly import assemble
from impedance_modules.control.supervisor import Ending
from impedance_modules.episode.reader import read_episode
from impedance_modules.errors import PlantNotFinite
from impedance_modules.runs.execution import RunOptions, RunResult, carry_out
from impedance_modules.runs.task_plant import sim_backend

BROKEN = {
    "velocity": (3, np.nan, "velocity of "),
    "motor_position": (1, np.inf, "velocity of "),
    "object_velocity": (2, np.nan, "object's velocity"),
    "work": ("push_work", np.inf, "push work"),
}
"""Part of the state -> its entry, what it becomes, and what the reason must name."""


def broken_at(backend: SimBackend, part: str, time: float) -> None:
    """Spoils one number of the plant's state at a time [s]."""
    plant = backend.plant
    advance, (entry, value, _) = plant.advance, BROKEN[part]

    def spoiling(command: np.ndarray | None) -> None:
        if plant.time >= time - 1e-9:
            getattr(plant.state.start, part)[entry] = value
        advance(command)

    plant.advance = spoiling


def ran(folder: Path, part: str, time: float, rate: float, duration: float | None = None) -> RunResult:
    assembly = assemble("box-hold", effects=None, rate=rate, scale=1.0, arm=None)
    backend = sim_backend(assembly, 0)
    broken_at(backend, part, time)
    options = RunOptions(folder, 0, duration, live=False, read_only=False, backend="sim")
    return carry_out(assembly, backend, options, lambda *_: None)


@pytest.mark.parametrize("rate", [1000.0, 500.0])
@pytest.mark.parametrize("part", BROKEN)
def test_the_run_stops_with_what_where_and_when(tmp_path: Path, part: str, rate: float) -> None:
    result = ran(tmp_path / "run", part, 0.2, rate)
    assert result.ending is Ending.STOPPED and not result.interrupted
    assert "plant not finite" in result.reason and BROKEN[part][2] in result.reason
    assert "at 0.20" in result.reason and "moved at" in result.reason
    episode = read_episode(tmp_path / "run")
    assert episode.complete and len(episode) == round(0.2 * rate) + 1
    assert result.summary["ending"] == "stopped" and "not finite" in result.summary["reason"]
    for values in (*episode.position.values(), *episode.effort_command.values()):
        assert np.isfinite(values).all()


@pytest.mark.parametrize("time", [0.1005, 0.2])
def test_it_also_counts_after_the_end_was_asked_for(tmp_path: Path, time: float) -> None:
    """While the run brakes, and while the robot settles in its own mode: never exit 0."""
    result = ran(tmp_path / "run", "velocity", time, 1000.0, duration=0.1)
    assert result.ending is Ending.STOPPED and "plant not finite" in result.reason


def test_a_broken_plant_says_so_until_it_is_reset() -> None:
    assembly = assemble("soft-hold", effects=None, rate=1000.0, scale=1.0, arm=None)
    backend = sim_backend(assembly, 0)
    backend.start()
    plant = backend.plant
    plant.state.start.position[0] = np.nan
    for _ in range(2):
        with pytest.raises(PlantNotFinite, match=r"position of \w+ is not finite at 0\.00\d0 s|velocity of"):
            plant.advance(None)
    backend.start()
    plant.advance(None)
    assert np.isfinite(plant.state.start.whole).all()
