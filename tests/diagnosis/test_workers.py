# SPDX-License-Identifier: BSD-3-Clause
"""A diagnosis gives the same answer in every number, whatever computes it: this process, local cores or a cluster."""

import json
import multiprocessing
import pickle
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

import impedance_modules
from impedance_modules.diagnosis.compared_recordings import diagnosed
from impedance_modules.diagnosis.data.log import InsufficientData
from impedance_modules.diagnosis.report.diagnosis_files import diagnosis_object
from impedance_modules.errors import BadFile, BadInput, ImpedanceError, PlantNotFinite, Problem, WorkerLost
from impedance_modules.worker_processes import ordered_map
from tests.diagnosis.test_diagnosis import URDF, record
from tests.support.commands import refusal

distributed = pytest.importorskip("distributed")


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four short recordings of two joints, of which one has friction, and their model."""
    folder = tmp_path_factory.mktemp("pendulum")
    (folder / "robot.urdf").write_text(URDF)
    record(folder, "coulomb_friction", seconds=10.0)[-1].unlink()
    return folder


def answer(folder: Path, **options: Any) -> str:
    logs = sorted(folder.glob("*.parquet"))
    found = diagnosed(logs, [], robot=None, urdf=folder / "robot.urdf", **options)
    return json.dumps(diagnosis_object(found), indent=1)


@pytest.fixture(scope="module")
def here(recordings: Path) -> str:
    """The answer of this process alone."""
    return answer(recordings)


@contextmanager
def cluster_of(workers: int, **options: Any) -> Iterator[Any]:
    """A Dask cluster on this machine; its workers are threads unless ``processes`` says otherwise."""
    given = {"threads_per_worker": 1, "dashboard_address": None, "memory_limit": 0, "processes": False}
    with distributed.LocalCluster(n_workers=workers, **{**given, **options}) as cluster:
        yield cluster


def test_two_local_cores_give_the_same_answer(recordings: Path, here: str) -> None:
    found = json.loads(here)
    assert found["causes"][0]["effect"] == "coulomb_friction" and found["gap"]["rollout"]["windows"]
    assert answer(recordings, jobs=2) == here


def test_a_cluster_by_its_address_gives_the_same_answer(
    recordings: Path, here: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with cluster_of(1, processes=True) as cluster:
        assert answer(recordings, scheduler=cluster.scheduler_address) == here
        monkeypatch.setattr(impedance_modules, "__version__", "0.0.1")
        with pytest.raises(BadInput, match=r"workers have version .* \(valid: 0.0.1, as here\)"):
            answer(recordings, scheduler=cluster.scheduler_address)


def test_another_machine_does_not_need_the_description(
    recordings: Path, here: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Everything that a worker needs is sent: here it does not find the URDF."""
    urdf = recordings / "robot.urdf"

    def elsewhere(function: Callable[[Any], Any], items: Iterable[Any], /) -> Iterator[Any]:
        for item in items:
            sent, given = pickle.loads(pickle.dumps((function, item)))
            hidden = urdf.rename(recordings / "hidden")
            found = pickle.dumps(sent(given))
            hidden.rename(urdf)
            yield pickle.loads(found)

    @contextmanager
    def far(*_: object) -> Iterator[Any]:
        yield elsewhere

    monkeypatch.setattr("impedance_modules.diagnosis.compared_recordings.ordered_map", far)
    assert answer(recordings) == here


def test_a_killed_process_ends_the_diagnosis_with_an_error(recordings: Path) -> None:
    def kill(words: str) -> None:
        if words == "evaluating candidates":
            for process in multiprocessing.active_children():
                process.kill()

    with pytest.raises(WorkerLost, match="has ended before its result was there"):
        answer(recordings, jobs=2, progress=kill)


def test_a_cluster_that_loses_its_workers_ends_the_diagnosis_with_an_error(
    recordings: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("impedance_modules.worker_processes.LOOKING", 0.2)
    with cluster_of(1) as cluster:

        def dismiss(words: str) -> None:
            if words == "evaluating candidates":
                cluster.scale(0)
                while cluster.scheduler.workers:
                    time.sleep(0.05)

        with pytest.raises(WorkerLost, match="it has no workers any more"):
            answer(recordings, scheduler=cluster.scheduler_address, progress=dismiss)


def nap(seconds: float) -> float:
    time.sleep(seconds)
    return seconds


def not_ready() -> None:
    raise BadInput("it was set up first")


def test_results_come_in_the_order_of_the_items_and_each_process_is_set_up() -> None:
    naps = [0.2, 0.0, 0.1, 0.0, 0.05]
    with cluster_of(2) as cluster:
        with ordered_map(None, cluster.scheduler_address, lambda: None) as each:
            assert list(each(nap, naps)) == naps
        with (
            ordered_map(None, cluster.scheduler_address, not_ready) as each,
            pytest.raises(BadInput, match="it was set up first"),
        ):
            list(each(nap, naps))


def test_without_dask_a_scheduler_or_workers_the_remedy_is_named(
    recordings: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("impedance_modules.worker_processes.CONNECTING", 0.5)
    words = ("diagnose", recordings, "--urdf", recordings / "robot.urdf", "--scheduler")
    assert "no Dask scheduler answers" in refusal(*words, "tcp://127.0.0.1:1")
    with cluster_of(0) as cluster:
        assert "no worker has joined" in refusal(*words, cluster.scheduler_address)
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert "pip install 'impedance-modules[cluster]'" in refusal(*words, "tcp://127.0.0.1:1")


@pytest.mark.parametrize(
    ("words", "says"),
    [(("--jobs", 0), "1 or more"), (("--jobs", 2, "--scheduler", "tcp://x:1"), "one of the two")],
)
def test_wrong_counts_are_refused(words: tuple[object, ...], says: str, tmp_path: Path) -> None:
    assert says in refusal("diagnose", tmp_path, "--urdf", tmp_path / "robot.urdf", *words)


def test_an_error_of_a_worker_arrives_as_it_was() -> None:
    problem = Problem(Path("patch.yaml"), 3, 1, "effects[0]", "there is no such joint", ("elbow",))
    errors = (BadInput("no"), InsufficientData("little"), BadFile([problem]), PlantNotFinite("infinite"))
    for error in errors:
        again: ImpedanceError = pickle.loads(pickle.dumps(error))
        assert type(again) is type(error) and str(again) == str(error)
        assert vars(again) == vars(error)
