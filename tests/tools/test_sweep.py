# SPDX-License-Identifier: BSD-3-Clause
"""`impedance sweep`: every point of the grid is run as the task would be, here or on a cluster."""

import csv
import shutil
import sys
from pathlib import Path

import pytest

from impedance_modules.errors import BadInput
from impedance_modules.tools.sweep_plan import SweepPlan, make_jobs, read_range
from impedance_modules.tools.sweep_runs import run_on_cluster, run_one
from tests.support.commands import invoke, refusal
from tests.support.paths import CHECKOUT

PATCH = CHECKOUT / "robots" / "baxter" / "patches" / "unknown-payload.yaml"
FRICTION = "environment.0.friction"


def table(folder: Path) -> list[dict[str, str]]:
    with (folder / "sweep.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def plan(*vary: str, **options: object) -> SweepPlan:
    values = {"effects": None, "draws": None, "seeds": 1, "seed": 0, "rate": None, "keep": None, **options}
    return SweepPlan("wipe-table", tuple(map(read_range, vary)), **{"duration": 0.3, **values})


def test_a_grid_is_every_combination_and_draws_stay_in_their_ranges() -> None:
    two = ("environment.0.friction=0.1:0.5:3", "phases.touch.duration=1:2:2")
    jobs = make_jobs(plan(*two, seeds=2, seed=7))
    assert len(jobs) == 12 and [job.seed for job in jobs[:2]] == [7, 8]
    assert {tuple(round(value, 9) for value in job.values.values()) for job in jobs} == {
        (f, d) for f in (0.1, 0.3, 0.5) for d in (1.0, 2.0)
    }

    def drawn(seed: int) -> list[float]:
        return [job.values[FRICTION] for job in make_jobs(plan(*two, draws=50, seed=seed))]

    assert len(set(drawn(0))) == 50 and all(0.1 <= value <= 0.5 for value in drawn(0))
    assert drawn(0) == drawn(0) != drawn(1)


def test_a_patch_s_numbers_are_varied_too_and_a_run_is_repeatable() -> None:
    path = "effects.0.parameters.right_hand.m.value"
    jobs = make_jobs(plan(f"{path}=0:0.5:2", effects=PATCH, duration=0.15))
    light, heavy = map(run_one, jobs)
    assert heavy.results["right_hand tracking peak [m]"] > 2.0 * light.results["right_hand tracking peak [m]"]
    assert run_one(jobs[0]) == light


def test_the_verb_writes_a_table_and_plots_and_says_what_was_refused(tmp_path: Path) -> None:
    """A table too soft to bear, a good one: one is run and one refused, both are rows."""
    tank, stiffness = "safety.tank.initial", "arms.right.springs.hand.stiffness.x"
    words = ("sweep", "wipe-table", "--duration")
    invoke(*words, 0.3, "--vary", f"{tank}=0.5:5.3:2", "--jobs", 1, "--keep", "--out", tmp_path)
    rows = table(tmp_path)
    assert [float(row["safety.tank.initial"]) for row in rows] == [0.5, 5.3]
    assert rows[0]["ending"] == "refused" and "the task needs" in rows[0]["reason"]
    assert float(rows[1]["duration [s]"]) == pytest.approx(0.3, abs=0.02)
    assert (tmp_path / "runs" / "run-00001" / "summary.json").is_file()
    assert "holds a sweep already" in refusal(*words, 0.3, "--vary", f"{tank}=5:6", "--out", tmp_path)
    invoke(*words, 0.2, "--vary", f"{stiffness}=200:300:2", "--jobs", 2, "--out", tmp_path / "two")
    assert len(table(tmp_path / "two")) == 2 and list((tmp_path / "two").glob("over-*.png"))


def test_a_dask_cluster_gives_the_same_rows() -> None:
    distributed = pytest.importorskip("distributed")
    jobs = make_jobs(plan("environment.0.friction=0.1:0.5:2", duration=0.1))
    here = {"processes": False, "dashboard_address": None}
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, **here) as cluster:
        rows = sorted(run_on_cluster(jobs, cluster.scheduler_address), key=lambda row: row.number)
    assert rows == [run_one(job) for job in jobs]


REFUSED = {
    "no range": ((FRICTION,), "PATH=LO:HI"),
    "backwards": ((f"{FRICTION}=2:1",), "LO up to HI"),
    "no such path": (("environment.0.frction=0:1",), "did you mean 'friction'?"),
    "no such spring": (("arms.right.springs.elbow.stiffness.x=0:1",), "valid: hand"),
    "beyond a number": ((f"{FRICTION}.x=0:1",), "end the path here"),
    "no number": (("arms.right.springs.hand.frame=0:1",), "a path to a number"),
    "twice": ((f"{FRICTION}=0:1", "--vary", f"{FRICTION}=0:2"), "same path twice"),
    "no patch": (("effects.0.parameters.right_s0.fc.value=0:1",), "--effects PATCH"),
    "too many": ((f"{FRICTION}=0:1:200000",), "too many"),
    "another robot's patch": (
        (f"{FRICTION}=0:1", "--effects", CHECKOUT / "tasks" / "wipe-table.yaml"), "tasks/wipe-table.yaml:",
    ),
    "no seeds": ((f"{FRICTION}=0:1", "--seeds", "0"), "1 or more"),
    "both": ((f"{FRICTION}=0:1", "--jobs", "1", "--scheduler", "tcp://x:1"), "one of the two"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_a_wrong_sweep_is_told_what_would_be_valid(name: str, tmp_path: Path) -> None:
    words, says = REFUSED[name]
    assert says in refusal("sweep", "wipe-table", "--vary", *words, "--out", tmp_path / "never")
    assert not (tmp_path / "never").exists()


def test_without_dask_or_a_scheduler_the_remedy_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    jobs = make_jobs(plan("environment.0.friction=0.1:0.5:2"))
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(BadInput, match="pip install"):
        list(run_on_cluster(jobs, "tcp://127.0.0.1:1"))
    monkeypatch.undo()
    monkeypatch.setattr("impedance_modules.worker_processes.CONNECTING", 0.5)
    with pytest.raises(BadInput, match="no Dask scheduler answers"):
        list(run_on_cluster(jobs, "tcp://127.0.0.1:1"))


def beside_its_robot(folder: Path) -> Path:
    """A copy of a task whose robot is known beside it only."""
    shutil.copytree(CHECKOUT / "robots" / "single_wheel", folder / "robots" / "my_wheel")
    text = (CHECKOUT / "tasks" / "thesis" / "one-joint.yaml").read_text()
    task = folder / "task.yaml"
    task.write_text(text.replace("robot: single_wheel", "robot: my_wheel"))
    return task


def test_a_robot_beside_the_task_is_found_by_every_run(tmp_path: Path) -> None:
    task = beside_its_robot(tmp_path)
    rz = "arms.wheel.springs.hand.stiffness.rz"
    done = invoke(
        "sweep", task, "--vary", f"{rz}=4:6:2", "--duration", 0.1, "--jobs", 1, "--out", tmp_path / "o"
    )
    assert done.return_value == 0 and "refused" not in done.output
    assert [row["ending"] for row in table(tmp_path / "o")] == ["interrupted"] * 2


def test_a_sweep_of_nothing_but_refused_runs_fails(tmp_path: Path) -> None:
    task = beside_its_robot(tmp_path)
    rz = "arms.wheel.springs.hand.stiffness.rz"
    words = ("sweep", task, "--duration", 0.1, "--jobs", 1, "--vary")
    assert invoke(*words, f"{rz}=2e4:4e4:2", "--out", tmp_path / "all").return_value == 2
    assert [row["ending"] for row in table(tmp_path / "all")] == ["refused"] * 2
    assert invoke(*words, f"{rz}=5:2e4:2", "--out", tmp_path / "some").return_value == 0
