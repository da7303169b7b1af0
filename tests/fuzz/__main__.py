# SPDX-License-Identifier: BSD-3-Clause
"""Feeds the readers of inputs with changed files, guided by what parts of the package each input reaches.

    python -m tests.fuzz [--reader NAME] [--executions N] [--seed S]

Each reader has a process of its own with bounded memory, so that one that a library crashes costs one input only.
Findings go to ``tests/corpus/READER/found-DIGEST``, where the tests judge them from then on. Atheris (libFuzzer) keeps
the inputs that reach something new and goes on from them; where it is not installed, only the corpus is changed. Exit
1 if there is a finding.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import random
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

from tests.support.paths import CHECKOUT

NAMES = (
    "task",
    "robot",
    "patch",
    "urdf",
    "mujoco",
    "map",
    "csv",
    "parquet",
    "bag",
    "mat",
    "sweep",
    "metadata",
)
EXECUTIONS = 20_000
FINE = ("read", "refused")
MOST_FINDINGS = 20
"""Kinds of findings of one reader that are kept."""


def main() -> int:
    options = read_options()
    if options.worker:
        Worker(options.worker, options.executions, options.seed, Path(options.report)).run()
        return 0
    names = [options.reader] if options.reader else list(NAMES)
    with tempfile.TemporaryDirectory() as folder:
        reports = [search(name, options.executions, options.seed, Path(folder)) for name in names]
    total = sum(sum(report["endings"].values()) for report in reports)
    found = sum(len(report["findings"]) for report in reports)
    print(f"{total} executions, {found} findings")
    return 1 if found else 0


def read_options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz")
    parser.add_argument("--reader", choices=NAMES)
    parser.add_argument("--executions", type=int, default=EXECUTIONS, metavar="N", help="of each reader")
    parser.add_argument("--seed", type=int, default=0, metavar="S")
    parser.add_argument("--worker", help=argparse.SUPPRESS)
    parser.add_argument("--report", help=argparse.SUPPRESS)
    return parser.parse_args()


def search(name: str, executions: int, seed: int, folder: Path) -> dict[str, object]:
    """Runs processes of one reader until so many inputs are done; returns what they report."""
    from tests.fuzz.readers import CORPUS

    began, whole = time.monotonic(), {"endings": Counter(), "findings": {}, "slowest": 0.0, "memory": 0}
    round_, crashes = 0, 0
    while (left := executions - sum(whole["endings"].values())) > 0 and crashes < MOST_FINDINGS:
        report = folder / f"{name}-{round_}.json"
        words = [
            "--worker",
            name,
            "--executions",
            str(left),
            "--seed",
            str(seed + round_),
            "--report",
            str(report),
        ]
        with (folder / f"{name}-{round_}.log").open("wb") as log:
            ended = subprocess.run(
                [sys.executable, "-m", "tests.fuzz", *words],
                cwd=CHECKOUT,
                stdout=log,
                stderr=log,
                check=False,
            )
        said = json.loads(report.read_text())
        whole["endings"].update(said["endings"])
        whole["findings"].update(said["findings"])
        whole["slowest"] = max(whole["slowest"], said["slowest"])
        whole["memory"] = max(whole["memory"], said["memory"])
        if sum(said["endings"].values()) < left:
            crashes += 1
            data = report.with_suffix(".input").read_bytes()
            path = CORPUS / name / f"found-{digest(data)}"
            path.write_bytes(data)
            whole["findings"][f"the process ended with {ended.returncode}"] = path.name
            whole["endings"]["crash"] += 1
        round_ += 1
    tell(name, whole, time.monotonic() - began)
    return whole


def tell(name: str, whole: dict[str, object], seconds: float) -> None:
    endings = ", ".join(f"{count} {ending}" for ending, count in whole["endings"].items())
    print(
        f"{name:<9} {sum(whole['endings'].values()):>7} executions in {seconds:5.0f} s: {endings};"
        f" slowest {whole['slowest']:.2f} s, grew by {whole['memory']} MB",
        flush=True,
    )
    for problem, file in whole["findings"].items():
        print(f"    {file}: {problem}", flush=True)


def digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:12]


class Worker:
    """Feeds one reader, and writes down how far it is."""

    def __init__(self, name: str, executions: int, seed: int, report: Path) -> None:
        self.endings: Counter[str] = Counter()
        self.findings: dict[str, str] = {}
        self.slowest, self.memory = 0.0, 0
        self._executions, self._draw, self._seed = executions, random.Random(f"{name} {seed}"), seed
        self._name, self._report = name, report
        self._input = os.open(report.with_suffix(".input"), os.O_RDWR | os.O_CREAT)
        self._guided = find_spec("atheris") is not None

    def run(self) -> None:
        self._write()
        judge = self._load()
        if not self._guided:
            while sum(self.endings.values()) < self._executions:
                self._one(judge, self._changed(self._draw.choice(self._seeds), LONGEST_INPUT, 0))
            self._write()
            return
        import atheris

        from tests.fuzz.readers import CORPUS

        with tempfile.TemporaryDirectory() as corpus:
            kept = f"-artifact_prefix={corpus}/"
            flags = [
                kept,
                f"-seed={self._seed + 1}",
                "-rss_limit_mb=0",
                "-timeout=90",
                f"-max_len={LONGEST_INPUT}",
                f"-artifact_prefix={corpus}/",
            ]
            words = [sys.argv[0], *flags, "-len_control=0", "-verbosity=0", corpus, str(CORPUS / self._name)]
            atheris.Setup(words, lambda data: self._one(judge, data), custom_mutator=self._changed)
            atheris.Fuzz()

    def _load(self) -> Callable[[bytes], object]:
        """Imports the package, instrumented where there is somebody to look."""
        if self._guided:
            import atheris

            with atheris.instrument_imports(include=["impedance_modules"]):
                from tests.fuzz import judge, readers
        else:
            from tests.fuzz import judge, readers
        from tests.fuzz.mutate import mutated

        reader = readers.READERS[self._name]
        self._seeds, self._mutated, self._text = reader.seeds(), mutated, reader.text
        for seed in self._seeds:
            self._note(seed)
            judge.judge(reader, seed)
        judge.limit_memory()
        self._memory, self._at_first = judge.memory, judge.memory()
        return lambda data: judge.judge(reader, data)

    def _changed(self, data: bytes, _most: int, _seed: int) -> bytes:
        """Changes an input; atheris hands those in that reached something new."""
        start = data if data and self._draw.randrange(4) else self._draw.choice(self._seeds)
        return self._mutated(bytes(start), self._seeds, self._draw, text=self._text)

    def _one(self, judge: Callable[[bytes], object], data: bytes) -> None:
        self._note(data)
        began = time.monotonic()
        verdict = judge(data)
        self.slowest = max(self.slowest, time.monotonic() - began)
        self.endings[verdict.ending] += 1
        kind = verdict.problem.split("(")[-1] or verdict.ending
        known = any(kind in problem for problem in self.findings) or len(self.findings) >= MOST_FINDINGS
        if verdict.ending not in FINE and not known:
            self._keep(data, f"{verdict.ending}: {verdict.problem}")
        done = sum(self.endings.values())
        if done % 200 == 0 or done >= self._executions:
            self.memory = (self._memory() - self._at_first) >> 20
            self._write()
        if self._guided and done >= self._executions:
            os._exit(0)  # libFuzzer has no other end

    def _note(self, data: bytes) -> None:
        """Keeps the input that is under way where it outlives this process."""
        os.pwrite(self._input, data, 0)
        os.ftruncate(self._input, len(data))

    def _keep(self, data: bytes, problem: str) -> None:
        from tests.fuzz.readers import CORPUS

        path = CORPUS / self._name / f"found-{digest(data)}"
        path.write_bytes(data)
        self.findings[problem] = path.name
        self._write()

    def _write(self) -> None:
        said = {key: getattr(self, key) for key in ("endings", "findings", "slowest", "memory")}
        part = self._report.with_suffix(".part")
        part.write_text(json.dumps(said))
        part.replace(self._report)


LONGEST_INPUT = 200_000
"""Bytes."""

if __name__ == "__main__":
    sys.exit(main())
