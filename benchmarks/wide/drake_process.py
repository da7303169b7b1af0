# SPDX-License-Identifier: BSD-3-Clause
"""Drake in a process of its own: plans go in, arrays come out.

`python -m benchmarks.wide.drake_process` answers pickled plans on its standard input with pickled recordings on its
standard output, each behind its length in eight bytes. WIDE_DRAKE_PYTHON names the interpreter that has Drake.
"""

from __future__ import annotations

import os
import pickle
import struct
import subprocess
import sys
from pathlib import Path
from typing import IO

from benchmarks.wide.plan import Plan, RawLog

PYTHON = "WIDE_DRAKE_PYTHON"
ROOT = Path(__file__).resolve().parents[2]


class DrakeProcess:
    """Simulates plans in another process."""

    def __init__(self) -> None:
        """Starts the process with the interpreter of WIDE_DRAKE_PYTHON, or this one."""
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
        self._process = subprocess.Popen(
            [os.environ.get(PYTHON, sys.executable), "-m", "benchmarks.wide.drake_process"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            cwd=ROOT,
            env=environment,
        )

    def simulate(self, plan: Plan) -> RawLog:
        """Sends a plan and waits for its recording.

        Raises:
            RuntimeError: The process ended; what it printed says why.
        """
        if self._process.stdin is None or self._process.stdout is None:
            raise RuntimeError("the process of the second engine has no pipes")
        _send(self._process.stdin, plan)
        answer = _receive(self._process.stdout)
        if not isinstance(answer, RawLog):
            raise RuntimeError(
                f"the process of the second engine ended (valid: {PYTHON} names a Python that has Drake and numba)"
            )
        return answer

    def close(self) -> None:
        """Ends the process."""
        if self._process.stdin is not None:
            self._process.stdin.close()
        self._process.wait(10)


def _send(pipe: IO[bytes], what: object) -> None:
    data = pickle.dumps(what)
    pipe.write(struct.pack("<Q", len(data)) + data)
    pipe.flush()


def _receive(pipe: IO[bytes]) -> object:
    head = pipe.read(8)
    if len(head) < 8:
        return None
    return pickle.loads(pipe.read(struct.unpack("<Q", head)[0]))


def main() -> None:
    """Answers until the input ends."""
    from benchmarks.wide.simulation import simulate

    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints must not get among the answers
    while (plan := _receive(sys.stdin.buffer)) is not None:
        if isinstance(plan, Plan):
            _send(out, simulate(plan))


if __name__ == "__main__":
    main()
