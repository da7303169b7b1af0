# SPDX-License-Identifier: BSD-3-Clause
"""Who carries the runs out: this process, local cores, or an existing Dask cluster."""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from importlib import import_module
from typing import Any

from impedance_modules.errors import BadInput
from impedance_modules.tools.sweep_runs import SweepRow, run_one
from impedance_modules.tools.sweep_plan import SweepJob

CONNECTING = 10.0
"""For how long a cluster may take to answer [s]."""


def run_here(jobs: Sequence[SweepJob], cores: int) -> Iterator[SweepRow]:
    """Runs on local cores, and gives each run's row as soon as it is there; one core is this process itself."""
    if cores == 1 or len(jobs) == 1:
        yield from map(run_one, jobs)
        return
    # Forked processes would inherit threads of numerical libraries in the middle of something.
    fresh = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(cores, len(jobs)), mp_context=fresh) as pool:
        waiting = [pool.submit(run_one, job) for job in jobs]
        try:
            for done in as_completed(waiting):
                yield done.result()
        finally:
            for job in waiting:
                job.cancel()


def run_on_cluster(jobs: Sequence[SweepJob], address: str) -> Iterator[SweepRow]:
    """Runs on an existing Dask cluster, whose workers have this package.

    Raises:
        BadInput: Dask is not installed here, or nobody answers at the address.
    """
    try:
        distributed: Any = import_module("distributed")
    except ImportError:
        raise BadInput(
            "--scheduler needs Dask, which is not installed (valid: pip install 'impedance-modules[cluster]', or"
            " leave --scheduler out to use this machine's cores)"
        ) from None
    try:
        client = distributed.Client(address, timeout=CONNECTING)
    except (OSError, ValueError) as error:
        raise BadInput(
            f"--scheduler {address}: no Dask scheduler answers there ({error}) (valid: the address that"
            " `dask scheduler` prints, e.g. tcp://192.168.0.2:8786)"
        ) from None
    with client:
        waiting = client.map(run_one, list(jobs), pure=False)
        try:
            for done in distributed.as_completed(waiting):
                yield done.result()
        finally:
            client.cancel(waiting)
