# SPDX-License-Identifier: BSD-3-Clause
"""Kills recording processes (kill -9) at random moments and says what was lost.

Run: ``python -m benchmarks.runs.killed_recordings [--kills 200] [--seed 0]``. Three kinds of process take turns:
``robot`` records 1 kHz in real time and never waits for the disk, ``simulation`` records as fast as it can, and ``run``
is ``impedance run press-and-slide``, killed at any moment from its first row until shortly after its last, when it
merges.

After every kill a stock pyarrow reads what is there, rerun opens ``recording.rrd``, and the package opens the folder,
which merges it. Lost is the time from the last row on the disk to the last one that was handed to the writer.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

from benchmarks.runs.episode_memory import any_metadata, columns
from impedance_modules.episode.reader import read_episode
from impedance_modules.episode.run_folder import EPISODE, RECORDING
from impedance_modules.episode.view_layout import TIMELINE
from impedance_modules.episode.writer import EpisodeWriter

KINDS = ("robot", "simulation", "run")
TASK = "press-and-slide"
LONGEST = 4.0
"""A recording that does not end by itself is killed up to so long after its first row [s]."""
STARTING = 120.0
"""How long a process may take until its first row [s]."""


@dataclass(frozen=True)
class Found:
    """What a kill left.

    Attributes:
        recorded: Time of the last row that the process handed to the writer [s].
        lost: From the last row that a stock reader finds [s].
        merged: The episode was whole already.
        shown: From the last instant in the rerun recording to ``recorded`` [s]; None without such a recording.
    """

    recorded: float
    lost: float
    merged: bool
    shown: float | None


def main() -> None:
    """Kills, looks, prints."""
    options = argparse.ArgumentParser()
    options.add_argument("--kills", type=int, default=200)
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--record", nargs=2, metavar=("KIND", "DIR"), help="What is killed.")
    given = options.parse_args()
    if given.record:
        record(given.record[0], Path(given.record[1]))
        return
    rng = np.random.default_rng(given.seed)
    longest = dict.fromkeys(KINDS, LONGEST) | {"run": unkilled_run()}
    found: dict[str, list[Found]] = {kind: [] for kind in KINDS}
    while sum(map(len, found.values())) < given.kills:
        kind = KINDS[sum(map(len, found.values())) % len(KINDS)]
        with tempfile.TemporaryDirectory() as folder:
            if record_and_kill(kind, Path(folder) / "run", rng.uniform(0.0, longest[kind])):
                found[kind].append(look(Path(folder) / "run"))
                print(
                    f"\r{sum(map(len, found.values()))} of {given.kills}", end="", file=sys.stderr, flush=True
                )
    print_table(found)


def record(kind: str, directory: Path) -> None:
    """Records without an end, or a run; notes the time of every row where a kill does not reach it."""
    noted = np.memmap(directory.with_suffix(".last"), dtype=float, mode="r+", shape=(1,))
    append = EpisodeWriter.append

    def append_and_note(writer: EpisodeWriter, row: np.ndarray, phase: str | None = None) -> None:
        append(writer, row, phase)
        noted[0] = row[0]

    EpisodeWriter.append = append_and_note  # type: ignore[method-assign]
    if kind == "run":
        from impedance_modules.cli.main import main as impedance

        sys.argv = ["impedance", "run", TASK, "--out", str(directory)]
        impedance()
    names = columns()
    writer = EpisodeWriter(directory, names, any_metadata(), wait_for_disk=kind == "simulation")
    row, start = np.zeros(len(names) - 1), time.perf_counter()
    for index in range(1, sys.maxsize):
        row[:] = index * 1e-3
        writer.append(row, "press")
        while kind == "robot" and time.perf_counter() - start < index * 1e-3:
            time.sleep(2e-4)


def start(kind: str, directory: Path) -> tuple[subprocess.Popen[bytes], np.ndarray]:
    """Starts a recording process and waits for its first row; returns it and the place of its last row's time."""
    directory.parent.mkdir(exist_ok=True)
    np.zeros(1).tofile(directory.with_suffix(".last"))
    noted = np.memmap(directory.with_suffix(".last"), dtype=float, mode="r")
    command = [sys.executable, "-m", "benchmarks.runs.killed_recordings", "--record", kind, str(directory)]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    deadline = time.monotonic() + STARTING
    while noted[0] == 0.0 and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.001)
    return process, noted


def unkilled_run() -> float:
    """Returns how long a run takes from its first row to a little after its last, when it merges and draws [s]."""
    with tempfile.TemporaryDirectory() as folder:
        process, noted = start("run", Path(folder) / "run")
        began = last = time.monotonic()
        row = 0.0
        while process.poll() is None:
            if noted[0] > row:
                row, last = float(noted[0]), time.monotonic()
            time.sleep(0.01)
        if process.returncode != 0:
            raise SystemExit("the run did not end by itself")
        return 1.1 * (last - began)


def record_and_kill(kind: str, directory: Path, after: float) -> bool:
    """Kills a recording process ``after`` seconds from its first row; False if it had ended by then."""
    process, _ = start(kind, directory)
    time.sleep(after)
    ended = process.poll() is not None
    process.kill()
    process.wait()
    return not ended


def look(directory: Path) -> Found:
    """Reads what a kill left with stock pyarrow, then with rerun and with the package.

    Raises:
        SystemExit: Rows are missing, twice or in disorder, a file cannot be read, or something is left behind.
    """
    recorded = float(np.fromfile(directory.with_suffix(".last"))[0])
    times = stock_times(directory)
    if np.any(np.diff(times) <= 0.0) or np.any(np.diff(times) > 0.0021):
        raise SystemExit(f"{directory}: rows are missing or in disorder")
    shown = last_shown(directory / RECORDING)
    merged = (directory / EPISODE).exists()
    if len(times):
        again = read_episode(directory)
        left = [path.name for path in directory.iterdir() if path.name.startswith(".")]
        if not np.array_equal(again.time, times) or left:
            raise SystemExit(f"{directory}: opened, it differs from what stock pyarrow read, or holds {left}")
    lost = recorded - (float(times[-1]) if len(times) else 0.0)
    return Found(recorded, lost, merged, None if shown is None else recorded - shown)


def stock_times(directory: Path) -> np.ndarray:
    """Returns the time of every row that a stock reader finds."""
    whole = directory / EPISODE
    paths: Sequence[Path] = [whole] if whole.exists() else sorted(directory.glob("*.parquet"))
    found = [pq.read_table(path, page_checksum_verification=True)["time"].to_numpy() for path in paths]
    return np.concatenate([np.zeros(0), *found])


def last_shown(path: Path) -> float | None:
    """Returns the last instant of a rerun recording [s], zero without any; None if there is no such file.

    Raises:
        SystemExit: rerun cannot open it.
    """
    from rerun.chunk import RrdReader

    if not path.exists():
        return None
    if path.stat().st_size == 0:
        return 0.0  # killed before the first byte
    # A kill cuts a message in two. rerun's viewer and commands stop there; its reader for Python wants a whole file.
    whole = path.parent.with_suffix(".rrd")
    opened = subprocess.run(
        [sys.executable, "-m", "rerun", "rrd", "merge", str(path), "-o", str(whole)],
        capture_output=True,
        check=False,
    )
    if opened.returncode:
        raise SystemExit(f"{path}: rerun cannot open it: {opened.stderr.decode()}")
    last = 0.0
    try:
        chunks = RrdReader(str(whole)).stream()
    except ValueError:  # killed before the first whole message: an empty recording
        return last
    for chunk in chunks:
        batch = chunk.to_record_batch()
        if not chunk.is_static and TIMELINE in batch.schema.names:
            last = max(last, float(batch[TIMELINE].cast("int64").to_numpy().max()) * 1e-9)
    return last


def print_table(found: dict[str, list[Found]]) -> None:
    """Prints one line for each kind."""
    print("kind        kills  merged  lost [s]: median  most  above 1 s   rerun lacks [s]: most")
    for kind, kills in found.items():
        lost = np.array([one.lost for one in kills])
        shown = [one.shown for one in kills if one.shown is not None]
        rerun = f"{max(shown):.2f}" if shown else "-"
        print(
            f"{kind:<11} {len(kills):5d}  {sum(one.merged for one in kills):6d}  {np.median(lost):16.2f}"
            f"  {lost.max():4.2f}  {np.sum(lost > 1.0):9d}   {rerun:>21}"
        )


if __name__ == "__main__":
    main()
