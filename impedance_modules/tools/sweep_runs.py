# SPDX-License-Identifier: BSD-3-Clause
"""The runs of a sweep, on this process, local cores or an existing Dask cluster.

Each run has the checks, control and plant of ``impedance run``, without pictures.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import as_completed
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.control.loop import Interrupt, run_loop
from impedance_modules.control.supervisor import Supervisor
from impedance_modules.errors import ImpedanceError
from impedance_modules.runs.recorder import Recorder
from impedance_modules.runs.run_summary import Summary
from impedance_modules.runs.task_acceptance import accept
from impedance_modules.runs.task_plant import sim_backend
from impedance_modules.tools.sweep_plan import SweepJob
from impedance_modules.worker_processes import as_each_is_done, cluster, local_processes

REFUSED = "refused"
"""Ending of a run that ``check`` does not allow."""


@dataclass(frozen=True)
class SweepRow:
    """Result of one run.

    Attributes:
        number: Of the job.
        values: Path -> value.
        seed: Of the simulated noise.
        ending: As in ``summary.json``, or ``refused``.
        reason: Why it stopped or was refused; empty after a task that is done.
        results: Name with its unit -> number; empty for a refused run.
    """

    number: int
    values: Mapping[str, float]
    seed: int
    ending: str
    reason: str
    results: Mapping[str, float] = field(default_factory=dict)


def run_one(job: SweepJob) -> SweepRow:
    """Runs one job; a refusal is a result, too."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        out = folder / "run" if job.keep is None else job.keep
        (folder / "task.yaml").write_text(job.task, encoding="utf-8")
        patch = None if job.patch is None else folder / "patch.yaml"
        if patch is not None and job.patch is not None:
            patch.write_text(job.patch, encoding="utf-8")
        try:
            assembly = assemble(str(folder / "task.yaml"), effects=patch, rate=job.rate, scale=1.0, arm=None)
            accept(assembly)
            found = _carry_out(assembly, job, out)
        except ImpedanceError as error:
            reason = " | ".join(str(error).replace(f"{folder}/", "").splitlines())
            return SweepRow(job.number, job.values, job.seed, REFUSED, reason)
    return SweepRow(
        job.number, job.values, job.seed, str(found["ending"]), str(found["reason"]), _results(found)
    )


def _carry_out(assembly: Assembly, job: SweepJob, out: Path) -> Mapping[str, Any]:
    backend = sim_backend(assembly, job.seed)
    supervisor = Supervisor(assembly, grippers=backend)
    supervisor.controller.warm()
    first = backend.start()
    recorder = Recorder(out, supervisor, first.acting, job.seed, "sim", simulated=True, real=None)
    summary = Summary(assembly, supervisor, recorder.columns, "sim", job.seed)

    def add(state: Any, effort: Any, late: bool, asked: bool) -> None:
        recorder.add(state, effort, late=late, interrupted=asked)
        summary.add(recorder.row)

    with ExitStack() as stack:
        stack.callback(recorder.abandon)
        supervisor.start(first)
        run_loop(
            supervisor,
            backend,
            first.state,
            add,
            Interrupt(),
            duration=job.duration,
            paced=False,
            read_only=False,
        )
        found = summary.write(out, interrupted=False)
        recorder.close(str(found["ending"]), str(found["reason"]))
        return found


def _results(found: Mapping[str, Any]) -> dict[str, float]:
    results = {
        "duration [s]": float(found["duration"]),
        "tank lowest [J]": float(found["tank"]["lowest"]),
        "cycles slowed": float(found["tank"]["cycles_slowed"]),
        "peak torque of limit": max(found["torque_peak_over_limit"].values()),
    }
    for hand, numbers in found["hands"].items():
        results[f"{hand} tracking rms [m]"] = float(numbers["tracking_rms"])
        results[f"{hand} tracking peak [m]"] = float(numbers["tracking_peak"])
        results[f"{hand} peak force [N]"] = float(numbers["peak_force"])
    return results


def run_here(jobs: Sequence[SweepJob], cores: int) -> Iterator[SweepRow]:
    """Runs on local cores, and gives each run's row as soon as it is there; one core is this process itself."""
    if cores == 1 or len(jobs) == 1:
        yield from map(run_one, jobs)
        return
    with local_processes(min(cores, len(jobs))) as pool:
        for done in as_completed([pool.submit(run_one, job) for job in jobs]):
            yield done.result()


def run_on_cluster(jobs: Sequence[SweepJob], address: str) -> Iterator[SweepRow]:
    """Runs on an existing Dask cluster, whose workers have this package.

    Raises:
        BadInput: Dask is not installed here, no scheduler answers at the address, or its workers cannot be used.
        WorkerLost: The cluster lost its workers before all runs were done.
    """
    with cluster(address) as client:
        waiting = client.map(run_one, list(jobs), pure=False)
        try:
            yield from as_each_is_done(waiting)
        finally:
            client.cancel(waiting)
