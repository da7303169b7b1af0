# SPDX-License-Identifier: BSD-3-Clause
"""`impedance sweep`: every point of the grid is run as the task would be, here or on a cluster."""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from impedance_modules.cli.main import impedance
from impedance_modules.errors import BadInput, ImpedanceError
from impedance_modules.tools.sweep_plan import SweepPlan, make_jobs, read_range
from impedance_modules.tools.sweep_runs import run_on_cluster, run_one
from tests.support.paths import CHECKOUT

TASK = "stiff-shallow"
ROOT = CHECKOUT
PATCH = ROOT / "robots" / "baxter" / "patches" / "unknown-payload.yaml"
STIFFNESS = "arms.right.springs.hand.stiffness.z"


def called(*words: str) -> Result:
    return CliRunner().invoke(impedance, ["sweep", *words], standalone_mode=False)


def table(folder: Path) -> list[dict[str, str]]:
    with (folder / "sweep.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def plan(*vary: str, **options: object) -> SweepPlan:
    values = {
        "effects": None,
        "draws": None,
        "seeds": 1,
        "seed": 0,
        "rate": None,
        "duration": 0.3,
        "keep": None,
        **options,
    }
    return SweepPlan("wipe-table", tuple(map(read_range, vary)), **values)


def test_a_grid_is_every_combination_and_draws_stay_in_their_ranges() -> None:
    two = ("environment.0.friction=0.1:0.5:3", "phases.touch.duration=1:2:2")
    jobs = make_jobs(plan(*two, seeds=2, seed=7))
    assert len(jobs) == 12 and [job.seed for job in jobs[:2]] == [7, 8]
    assert {tuple(round(value, 9) for value in job.values.values()) for job in jobs} == {
        (f, d) for f in (0.1, 0.3, 0.5) for d in (1.0, 2.0)
    }
    drawn = [job.values["environment.0.friction"] for job in make_jobs(plan(*two, draws=50))]
    assert len(set(drawn)) == 50 and all(0.1 <= value <= 0.5 for value in drawn)
    assert drawn == [job.values["environment.0.friction"] for job in make_jobs(plan(*two, draws=50))]
    assert drawn != [job.values["environment.0.friction"] for job in make_jobs(plan(*two, draws=50, seed=1))]


def test_a_patch_s_numbers_are_varied_too_and_a_run_is_repeatable() -> None:
    path = "effects.0.parameters.right_hand.m.value"
    jobs = make_jobs(plan(f"{path}=0:0.5:2", effects=PATCH, duration=0.15))
    light, heavy = map(run_one, jobs)
    assert heavy.results["right_hand tracking peak [m]"] > 2.0 * light.results["right_hand tracking peak [m]"]
    assert run_one(jobs[0]) == light


def test_the_verb_writes_a_table_and_plots_and_says_what_was_refused(tmp_path: Path) -> None:
    """A table too soft to bear, a good one: one is run and one refused, both are rows."""
    found = called(
        "wipe-table", "--vary", "safety.tank.initial=0.5:5.3:2", "--duration", "0.3", "--jobs", "1",
        "--keep", "--out", str(tmp_path),
    )  # fmt: skip
    assert found.exception is None, found.exception
    rows = table(tmp_path)
    assert [float(row["safety.tank.initial"]) for row in rows] == [0.5, 5.3]
    assert rows[0]["ending"] == "refused" and "the task needs" in rows[0]["reason"]
    assert float(rows[1]["duration [s]"]) == pytest.approx(0.3, abs=0.02)
    assert (tmp_path / "runs" / "run-00001" / "summary.json").is_file()
    twice = called("wipe-table", "--vary", "safety.tank.initial=5:6", "--out", str(tmp_path))
    assert isinstance(twice.exception, BadInput) and "holds a sweep already" in str(twice.exception)
    again = called(
        "wipe-table", "--vary", "arms.right.springs.hand.stiffness.x=200:300:2", "--duration", "0.2", "--jobs",
        "2", "--out", str(tmp_path / "two"),
    )  # fmt: skip
    assert again.exception is None
    assert len(table(tmp_path / "two")) == 2 and list((tmp_path / "two").glob("over-*.png"))


def test_a_dask_cluster_gives_the_same_rows() -> None:
    distributed = pytest.importorskip("distributed")
    jobs = make_jobs(plan("environment.0.friction=0.1:0.5:2", duration=0.1))
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None
    ) as cluster:
        rows = sorted(run_on_cluster(jobs, cluster.scheduler_address), key=lambda row: row.number)
    assert rows == [run_one(job) for job in jobs]


REFUSED = {
    "no range": (("--vary", "environment.0.friction"), "PATH=LO:HI"),
    "backwards": (("--vary", "environment.0.friction=2:1"), "LO up to HI"),
    "no such path": (("--vary", "environment.0.frction=0:1"), "did you mean 'friction'?"),
    "no such spring": (("--vary", "arms.right.springs.elbow.stiffness.x=0:1"), "valid: hand"),
    "beyond a number": (("--vary", "environment.0.friction.x=0:1"), "end the path here"),
    "no number": (("--vary", "arms.right.springs.hand.frame=0:1"), "a path to a number"),
    "twice": (
        ("--vary", "environment.0.friction=0:1", "--vary", "environment.0.friction=0:2"),
        "same path twice",
    ),
    "no patch": (("--vary", "effects.0.parameters.right_s0.fc.value=0:1"), "--effects PATCH"),
    "too many": (("--vary", "environment.0.friction=0:1:200000"), "too many"),
    "another robot's patch": (
        ("--vary", "environment.0.friction=0:1", "--effects", str(ROOT / "tasks" / "wipe-table.yaml")),
        "tasks/wipe-table.yaml:",
    ),
    "no seeds": (("--vary", "environment.0.friction=0:1", "--seeds", "0"), "1 or more"),
    "both": (
        ("--vary", "environment.0.friction=0:1", "--jobs", "1", "--scheduler", "tcp://x:1"),
        "one of the two",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_wrong_sweep_is_told_what_would_be_valid(name: str, tmp_path: Path) -> None:
    words, says = REFUSED[name]
    found = called("wipe-table", *words, "--out", str(tmp_path / "never"))
    assert isinstance(found.exception, ImpedanceError) and found.exception.exit_code == 2
    assert says in str(found.exception)
    assert not (tmp_path / "never").exists()


def test_without_dask_or_a_scheduler_the_remedy_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    jobs = make_jobs(plan("environment.0.friction=0.1:0.5:2"))
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(BadInput, match="pip install"):
        list(run_on_cluster(jobs, "tcp://127.0.0.1:1"))
    monkeypatch.undo()
    monkeypatch.setattr("impedance_modules.tools.sweep_runs.CONNECTING", 0.5)
    with pytest.raises(BadInput, match="no Dask scheduler answers"):
        list(run_on_cluster(jobs, "tcp://127.0.0.1:1"))
