# SPDX-License-Identifier: BSD-3-Clause
"""Many items computed by several processes: local cores, or an existing Dask cluster.

An `OrderedMap` gives its results in the order of the items, whichever process is first: what is made of them does not
depend on the number of processes.
"""

from __future__ import annotations

import logging
import multiprocessing
import signal
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from typing import Any, Protocol, TypeVar

from impedance_modules.errors import BadInput, WorkerLost

Item = TypeVar("Item")
Result = TypeVar("Result")

CONNECTING = 10.0
"""For how long a cluster may take to answer [s]."""

LOOKING = 5.0
"""After so long without a result it is asked whether the cluster still has workers [s]."""

WARN_FROM = "distributed.admin.large-graph-warning-threshold"
"""Setting of Dask: size of an item from which it warns. Recordings are large, and few of them are sent at once."""

AHEAD = 2
"""Items per process that are sent before the oldest result is taken: none is idle, and few wait in memory."""


class OrderedMap(Protocol):
    """Calls a function on each item; gives the results in the order of the items, as ``map`` does."""

    def __call__(self, function: Callable[[Item], Result], items: Iterable[Item], /) -> Iterator[Result]:
        """Gives one result for each item."""


def map_here(function: Callable[[Item], Result], items: Iterable[Item], /) -> Iterator[Result]:
    """Calls a function on each item in this process."""
    return map(function, items)


def refuse_counts(jobs: int | None, scheduler: str | None) -> None:
    """Refuses what names no cores, or cores and a cluster at once.

    Args:
        jobs: Local cores; None where nobody says.
        scheduler: Address of a cluster; None without one.

    Raises:
        BadInput: Says what would be valid.
    """
    if jobs is not None and jobs < 1:
        raise BadInput(f"--jobs {jobs}: not a number of cores (valid: 1 or more)")
    if jobs is not None and scheduler is not None:
        raise BadInput("--jobs counts local cores, --scheduler uses none of them (valid: one of the two)")


@contextmanager
def ordered_map(jobs: int | None, scheduler: str | None, setup: Callable[[], None]) -> Iterator[OrderedMap]:
    """Gives a map over local cores or a cluster; one core is this process itself.

    Args:
        jobs: Local cores; None counts as one.
        scheduler: Address of an existing Dask cluster, which is used instead.
        setup: Called in another process before it computes an item.

    Raises:
        BadInput: Counts that cannot be, or a cluster that cannot be used.
        WorkerLost: While results are taken: a process ended before its result was there.
    """
    refuse_counts(jobs, scheduler)
    if scheduler is not None:
        with cluster(scheduler) as client:
            yield partial(_map_on_cluster, client, setup)
    elif jobs is None or jobs == 1:
        yield map_here
    else:
        with local_processes(jobs) as pool:
            yield partial(_map_in_pool, pool, AHEAD * jobs, setup)


@contextmanager
def local_processes(count: int) -> Iterator[ProcessPoolExecutor]:
    """Starts processes on this machine; what they have not begun is dropped at the end.

    Raises:
        WorkerLost: One of them ended before its result was there.
    """
    # Forked processes would inherit threads of numerical libraries in the middle of something.
    fresh = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(count, mp_context=fresh, initializer=_leave_interrupts)
    try:
        yield pool
    except BrokenProcessPool:
        raise WorkerLost(
            "a process that --jobs started has ended before its result was there: it was killed, or memory was short"
            " (valid: the same command again, with fewer --jobs if memory is short)"
        ) from None
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


@contextmanager
def cluster(address: str) -> Iterator[Any]:
    """Connects to an existing Dask cluster, whose workers have this package in the same version.

    Raises:
        BadInput: Dask is not installed here, no scheduler answers at the address, or its workers cannot be used.
        WorkerLost: Scheduler or workers ended before a result was there.
    """
    distributed = _distributed()
    try:
        client = distributed.Client(address, timeout=CONNECTING)
    except (OSError, ValueError) as error:
        raise BadInput(
            f"--scheduler {address}: no Dask scheduler answers there ({error}) (valid: the address that"
            " `dask scheduler` prints, e.g. tcp://192.168.0.2:8786)"
        ) from None
    with import_module("dask").config.set({WARN_FROM: "16 GB"}), _quiet(), client:
        _refuse_workers(client, address)
        try:
            yield client
        except _losses(distributed) as error:
            why = " ".join(str(error).split())
            raise WorkerLost(
                f"--scheduler {address}: the cluster has lost a worker or its scheduler before the result was there:"
                f" {why} (valid: the same command again once the cluster runs)"
            ) from None


def as_each_is_done(waiting: Sequence[Any]) -> Iterator[Any]:
    """Gives results of a cluster as soon as each is there, in no order."""
    for done in _distributed().as_completed(waiting):
        yield done.result()


@contextmanager
def _quiet() -> Iterator[None]:
    """Keeps Dask's log of a lost connection, some pages of it, away from the terminal: one error says it."""
    levels = [(handler, handler.level) for handler in logging.getLogger("distributed").handlers]
    for handler, _ in levels:
        handler.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for handler, level in levels:
            handler.setLevel(level)


class _NoWorkers(Exception):  # noqa: N818 - caught here, and named otherwise
    """All workers of a cluster have left it."""


def _losses(distributed: Any) -> tuple[type[BaseException], ...]:
    """What Dask raises where a worker or the scheduler has ended."""
    return _NoWorkers, distributed.KilledWorker, distributed.comm.CommClosedError, CancelledError


def _distributed() -> Any:
    try:
        return import_module("distributed")
    except ImportError:
        raise BadInput(
            "--scheduler needs Dask, which is not installed (valid: pip install 'impedance-modules[cluster]', or"
            " leave --scheduler out to use this machine's cores)"
        ) from None


def _refuse_workers(client: Any, address: str) -> None:
    """Refuses a cluster without workers, and workers that have another version of this package, or none."""
    try:
        client.wait_for_workers(1, timeout=CONNECTING)
    except TimeoutError:
        raise BadInput(
            f"--scheduler {address}: no worker has joined this scheduler (valid: start some,"
            f" `dask worker {address} --nthreads 1`)"
        ) from None
    own = package_version()
    try:
        found = set(client.run(package_version).values())
    except ImportError as error:
        raise BadInput(
            f"--scheduler {address}: its workers lack this package ({error}) (valid: install version {own} there)"
        ) from None
    if found != {own}:
        raise BadInput(
            f"--scheduler {address}: its workers have version {', '.join(sorted(found - {own}))} of this package"
            f" (valid: {own}, as here)"
        )


def package_version() -> str:
    """Version of this package in the process that is asked."""
    return str(import_module("impedance_modules").__version__)


def _leave_interrupts() -> None:
    """Leaves Ctrl-C to the process that started this one."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _after(setup: Callable[[], None], function: Callable[[Item], Result], item: Item) -> Result:
    setup()
    return function(item)


def _map_in_pool(
    pool: ProcessPoolExecutor,
    ahead: int,
    setup: Callable[[], None],
    function: Callable[[Item], Result],
    items: Iterable[Item],
    /,
) -> Iterator[Result]:
    work = partial(_after, setup, function)
    return _in_order(lambda item: pool.submit(work, item), lambda waiting: waiting.result(), ahead, items)


def _map_on_cluster(
    client: Any, setup: Callable[[], None], function: Callable[[Item], Result], items: Iterable[Item], /
) -> Iterator[Result]:
    work, ahead = partial(_after, setup, function), AHEAD * sum(client.nthreads().values())

    def taken(waiting: Any) -> Any:
        while True:
            try:
                return waiting.result(timeout=LOOKING)
            except TimeoutError:
                if waiting.done():
                    raise
                if not client.scheduler_info()["workers"]:
                    raise _NoWorkers("it has no workers any more") from None

    return _in_order(lambda item: client.submit(work, item, pure=False), taken, ahead, items)


def _in_order(
    sent: Callable[[Item], Any], taken: Callable[[Any], Result], ahead: int, items: Iterable[Item]
) -> Iterator[Result]:
    """Sends some items ahead and takes the oldest result first."""
    waiting: deque[Any] = deque()
    for item in items:
        waiting.append(sent(item))
        if len(waiting) >= ahead:
            yield taken(waiting.popleft())
    while waiting:
        yield taken(waiting.popleft())
