# SPDX-License-Identifier: BSD-3-Clause
"""The rerun recording of a run in progress: samples wait in a queue, the background thread writes them."""

from __future__ import annotations

import contextlib
import math
from collections import deque
from pathlib import Path

import numpy as np

from impedance_modules.episode.background import Background
from impedance_modules.episode.rerun_writer import RerunRecording, open_stream, refuse_short_disk
from impedance_modules.episode.run_folder import RECORDING
from impedance_modules.episode.view_scene import Scene, ViewSample, check_sample
from impedance_modules.episode.viewer import open_live_stream
from impedance_modules.errors import BadInput

RATE = 25.0
"""Samples per second of episode time that a viewer gets [Hz]: motion looks continuous."""
BATCH_TIME = 1.0
"""Episode time that is written at once [s]: long enough to be small on disk, short enough to follow."""
BATCH_PART = 0.02
LONGEST_BATCH = 5.0
"""A file's batches grow with it, this part of the time so far, to this [s]: rerun keeps 0.3 kB of every piece it has
written until the file is closed."""
LONGEST_QUEUE = 1000
FILE_TIMEOUT = 60.0
WINDOW_TIMEOUT = 2.0
"""How long the end of a run waits for the file and for a viewer's window [s]."""


class RecordingView:
    """Writes ``recording.rrd`` beside a run without ever holding the control loop.

        view = RecordingView(directory, scene, writer.background, name="press-box", live=False)
        ...
        if view.due(time):
            view.add(ViewSample(...))
        ...
        writer.close()   # stops the thread, which writes the view's last samples first
        view.close()

    Attributes:
        dropped: Samples thrown away because the thread could not keep up.
        failure: Why the recording could not be written, or None. It never stops a run; whoever closes it tells it.
    """

    def __init__(
        self,
        directory: Path,
        scene: Scene,
        background: Background,
        *,
        name: str,
        live: bool,
        rate: float = RATE,
    ) -> None:
        """Opens the recording.

        Args:
            directory: Of the run.
            scene: What is shown.
            background: The run's thread (``EpisodeWriter.background``).
            name: Of the recording.
            live: Opens a viewer window that follows the run.
            rate: Samples per second of episode time [Hz].

        Raises:
            BadInput: The rate is not positive, or ``live`` without a display.
        """
        if not rate > 0:
            raise BadInput(f"recording view: rate {rate} Hz (valid: positive)")
        self.dropped = 0
        self.failure: OSError | RuntimeError | None = None
        self._scene = scene
        self._period = 1.0 / rate
        self._next = -math.inf
        self._first: float | None = None
        self._longest_batch = BATCH_TIME if live else LONGEST_BATCH
        self._queue: deque[ViewSample] = deque()
        # Two streams: the file must not depend on a window that somebody may close.
        self._live = RerunRecording(open_live_stream(name), scene, background.pause) if live else None
        self._path = Path(directory) / RECORDING
        self._file = RerunRecording(open_stream(self._path, name), scene, background.pause)
        background.register(self._drain)

    def due(self, time: float) -> bool:
        """Returns whether a sample is wanted at this episode time [s]; costs nothing else."""
        return time >= self._next

    def add(self, sample: ViewSample) -> None:
        """Queues a sample; its arrays must not change afterwards.

        Raises:
            BadInput: The sample does not fit the scene.
        """
        check_sample(self._scene, sample)
        on_schedule = sample.time <= self._next + self._period
        self._next = (self._next if on_schedule else sample.time) + self._period
        if self.failure is not None:
            return
        if len(self._queue) >= LONGEST_QUEUE:
            self.dropped += 1
            return
        self._queue.append(sample)

    def close(self) -> None:
        """Finishes the file; call after the background thread has stopped."""
        self._drain(True)
        try:
            self._file.close(timeout=FILE_TIMEOUT)
        except RuntimeError as failure:
            self.failure = failure
        if self._live is not None:
            with contextlib.suppress(RuntimeError):
                self._live.close(timeout=WINDOW_TIMEOUT)

    def _drain(self, last: bool) -> None:
        """Writes what is queued once there is enough of it; runs in the thread."""
        queue = self._queue
        if not queue or self.failure is not None:
            return
        if not last and queue[-1].time - queue[0].time < self._batch_time(queue[-1].time):
            return
        samples = [queue.popleft() for _ in range(len(queue))]
        if self._live is not None:
            # A window that was closed before the run ended is the user's choice, not a failure.
            with contextlib.suppress(RuntimeError):
                self._live.write(samples)
        try:
            refuse_short_disk(self._path)
            self._file.write(samples)
        except (OSError, RuntimeError) as failure:
            self.failure = failure

    def _batch_time(self, now: float) -> float:
        """Returns how much episode time is written at once [s]."""
        self._first = now if self._first is None else self._first
        return float(np.clip(BATCH_PART * (now - self._first), BATCH_TIME, self._longest_batch))
