# SPDX-License-Identifier: BSD-3-Clause
"""Writes the mesh of the task ``hold-to-fouled-pipe``: ``python -m docs.fouled_pipe_file``."""

from __future__ import annotations

from pathlib import Path

from impedance_experiments.fouled_pipe import fouled_pipe, stl_file

PATH = Path(__file__).parents[1] / "tasks" / "thesis" / "fouled-pipe.stl"


def made() -> bytes:
    """Makes the file: a pipe of 20 cm, 40 cm long, with up to 4 mm grown on it."""
    return stl_file(fouled_pipe(seed=1, diameter=0.2, length=0.4, growth=0.004, spacing=0.014))


if __name__ == "__main__":
    PATH.write_bytes(made())
