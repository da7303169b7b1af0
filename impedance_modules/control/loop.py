# SPDX-License-Identifier: BSD-3-Clause
"""The fixed-rate loop: read, decide, write, record, until the task is done or something stops it."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.backends.protocol import Backend
from impedance_modules.control.signals import handled_by
from impedance_modules.control.supervisor import Supervisor
from impedance_modules.errors import EndOfRecording, NotRecorded, PlantNotFinite, RobotStopped
from impedance_modules.robot.state import RobotState
from impedance_modules.safety.stop_levels import Event

OnCycle = Callable[[RobotState, Array, bool, bool], None]
"""Called after every cycle with the state, the torque in force (zero where none is), lateness, interrupt."""


class Interrupt:
    """Remembers that somebody asked for a stop, by Ctrl-C, say; a second time changes nothing."""

    def __init__(self) -> None:
        self.asked = False

    @contextmanager
    def listening(self) -> Iterator[Interrupt]:
        """Turns Ctrl-C, SIGTERM and SIGHUP into a wish for the duration of a run."""
        with handled_by(self._ask):
            yield self

    def _ask(self, number: int, frame: FrameType | None) -> None:  # noqa: ARG002 - the signal module's signature
        self.asked = True


@contextmanager
def no_collections() -> Iterator[None]:
    """Keeps the garbage collector out of the loop; a full collection takes 100 ms."""
    enabled = gc.isenabled()
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        gc.unfreeze()
        if enabled:
            gc.enable()


def run_loop(
    supervisor: Supervisor,
    backend: Backend,
    first: RobotState,
    on_cycle: OnCycle,
    interrupt: Interrupt,
    *,
    duration: float | None,
    paced: bool,
    read_only: bool,
) -> None:
    """Carries out a task on a started robot; ``backend.finish`` is called whatever happens.

    Args:
        supervisor: Started with the robot's first state.
        backend: Started.
        first: That state.
        on_cycle: Records.
        interrupt: Asked, it brakes and ends the run.
        duration: Ends the run safely after this time [s]; None lets the task decide.
        paced: True where time is real: a torque later than its period is not sent.
        read_only: Computes everything and sends nothing.
    """
    assembly = supervisor.assembly
    state: RobotState | None = first
    end = np.inf if duration is None else first.time + duration - 0.5 * assembly.period
    nothing = np.zeros(assembly.model.n)
    last = nothing.copy()
    late, newest = False, first.time
    try:
        while supervisor.ending is None:
            began = time.perf_counter()
            request = _stop_request(interrupt, state, end)
            effort = supervisor.step(state, late=late, stop_request=request)
            missed = late
            late = paced and effort is not None and time.perf_counter() - began > assembly.period
            if effort is not None and not late:
                np.copyto(last, effort)
                if not read_only:
                    backend.write(last)
            supervisor.look()
            if state is not None:
                # A torque that was ready too late did not leave: the one before goes on acting.
                on_cycle(state, nothing if effort is None else last, missed, request is not None)
            if supervisor.ending is None:
                state = _fresh(backend.read(), newest)
                newest = newest if state is None else state.time
    except EndOfRecording as end_of_recording:
        supervisor.note(str(end_of_recording))
    except RobotStopped as stop:
        supervisor.halt(Event(stop.event), stop.detail)
    except NotRecorded as failure:
        supervisor.halt(Event.NOT_RECORDED, str(failure))
        raise
    except MemoryError:
        supervisor.halt(Event.MEMORY_SHORT, "a cycle asked for memory and got none")
    finally:
        try:
            backend.finish("release" if supervisor.released else "hold")
        except PlantNotFinite as stop:
            supervisor.halt(Event(stop.event), stop.detail)


def _fresh(state: RobotState | None, newest: float) -> RobotState | None:
    """Passes on a sample that is newer than the last [s]; the same one again means that the robot's clock stands."""
    return state if state is not None and state.time > newest else None


def _stop_request(interrupt: Interrupt, state: RobotState | None, end: float) -> str | None:
    if interrupt.asked:
        return "asked to stop"
    if state is not None and state.time >= end:
        return "the time given to the run is over"
    return None
