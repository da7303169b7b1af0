# SPDX-License-Identifier: BSD-3-Clause
"""A recording's background work pauses while a control loop computes, and never for ever."""

import threading
import time
from collections.abc import Callable

from impedance_modules.episode import background as background_module
from impedance_modules.episode.background import LONGEST_PAUSE, Background


class Steps:
    """A job in small pieces, which says when each of them was done."""

    def __init__(self, pause: Callable[[], None]) -> None:
        self.done: list[float] = []
        self.over = threading.Event()
        self._pause = pause

    def __call__(self, last: bool) -> None:
        if last:
            return
        for _ in range(200):
            self._pause()
            self.done.append(time.monotonic())
        self.over.set()


def run_with_loop(background: Background, loop: Callable[[Steps], None]) -> Steps:
    steps = Steps(background.pause)
    background.register(steps)
    background.wake()
    loop(steps)
    background.stop()
    return steps


def test_pieces_are_done_while_the_loop_waits_and_not_while_it_works(monkeypatch) -> None:
    monkeypatch.setattr(background_module, "LONGEST_PAUSE", 30.0)
    background, spans = Background(60.0), []

    def loop(steps: Steps) -> None:
        for _ in range(5):
            before = len(steps.done)
            background.free_for(-1.0)
            time.sleep(0.01)
            spans.append(len(steps.done) - before)
        background.free_for(60.0)
        assert steps.over.wait(10.0)

    background.free_for(-1.0)
    steps = run_with_loop(background, loop)
    # A round's first piece may have begun just before; everything else waited for the loop.
    assert sum(spans) <= 10
    assert len(steps.done) == 200


def test_a_loop_that_stops_calling_is_waited_for_once() -> None:
    background = Background(60.0)
    background.free_for(-1.0)
    began = time.monotonic()
    steps = run_with_loop(background, lambda steps: steps.over.wait(10.0))
    assert steps.done[0] - began >= LONGEST_PAUSE
    assert len(steps.done) == 200 and steps.done[-1] - steps.done[0] < 20.0 * LONGEST_PAUSE


def test_without_a_loop_jobs_never_pause() -> None:
    background = Background(60.0)
    steps = run_with_loop(background, lambda steps: steps.over.wait(10.0))
    assert steps.done[-1] - steps.done[0] < 10.0 * LONGEST_PAUSE
