# SPDX-License-Identifier: BSD-3-Clause
"""Memory and time of `impedance diagnose` on an hour of both arms of Baxter at 1 kHz, which it makes itself.

    python -m benchmarks.diagnosis.hour_of_two_arms [--minutes 60]

Multisines on all 14 joints; torques of the rigid links at 50 Hz, linear between, with friction on one joint. The
springs of Baxter's joints are not simulated, so the answer finds a gap; how much memory it takes does not depend on
that.
Printed: exit, seconds, processor time and the largest resident memory of a process of its own.
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path

import click
import numpy as np
import pinocchio as pin
import pyarrow as pa
import pyarrow.parquet as pq

from benchmarks.blind.run import measured
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.robot_reader import read_robot

RATE, EVERY, ROWS = 1000, 20, 100_000
"""Samples a second; of which the torque is computed; rows that are written at once."""

ABOUT = {
    "format": 1, "robot": "baxter", "episode": "hour", "effort_source": "joint_sensor",
    "gravity_compensation": "robot", "repeat_of": None, "task": "",
}  # fmt: skip


class Motion:
    """Three tones on each joint, within a quarter of its range, and the torque of the nominal links."""

    def __init__(self, model: RobotModel) -> None:
        """Draws the tones."""
        random = np.random.default_rng(0)
        joints = [model.spec.joints[name] for name in model.joint_names]
        low, high = (np.array([getattr(j, end) for j in joints]) for end in ("position_min", "position_max"))
        self.middle, self.amplitude = 0.5 * (low + high), (high - low) / 24.0
        self.turn = 2.0 * np.pi * random.uniform(0.05, 0.4, (3, model.n))
        self.phase = random.uniform(0.0, 2.0 * np.pi, (3, model.n))
        self.rotor = np.array([joint.reflected_inertia for joint in joints])
        self.links, self.data, self.random = model.pin_model, model.pin_model.createData(), random

    def columns(self, time: np.ndarray, names: tuple[str, ...]) -> dict[str, np.ndarray]:
        """Channels of some samples, with the sensors' noise."""
        angle = self.turn * time[:, None, None] + self.phase
        q = self.middle + self.amplitude * np.sin(angle).sum(axis=1)
        v = self.amplitude * (self.turn * np.cos(angle)).sum(axis=1)
        a = -self.amplitude * (self.turn**2 * np.sin(angle)).sum(axis=1)
        few = np.arange(0, len(time), EVERY)
        torque = [pin.rnea(self.links, self.data, q[k], v[k], a[k]).copy() for k in few]
        weight = [pin.computeGeneralizedGravity(self.links, self.data, q[k]).copy() for k in few]
        needed, carried = (
            np.column_stack([np.interp(time, time[few], column) for column in np.array(part).T])
            for part in (torque, weight)
        )
        needed[:, 2] += 0.4 * np.sign(v[:, 2])
        noise = self.random.standard_normal((3, *q.shape)) * np.array([5e-5, 2e-3, 0.05])[:, None, None]
        channels = {
            "position": q + noise[0],
            "velocity": v + noise[1],
            "effort": needed + noise[2],
            "effort_command": needed + self.rotor * a - carried,
        }
        out = {
            f"{kind}.{name}": values[:, k]
            for kind, values in channels.items()
            for k, name in enumerate(names)
        }
        return {"time": time, **out}


@click.command()
@click.option("--minutes", default=60.0, show_default=True, help="Length of the recording [min].")
def main(minutes: float) -> None:
    """Makes the recording and diagnoses it."""
    model = RobotModel(read_robot("baxter"))
    motion, names = Motion(model), tuple(model.joint_names)
    with tempfile.TemporaryDirectory() as folder:
        path, samples = Path(folder) / "hour.parquet", round(60.0 * minutes * RATE)
        writer = None
        for first in range(0, samples, ROWS):
            table = pa.table(motion.columns(np.arange(first, min(first + ROWS, samples)) / RATE, names))
            table = table.replace_schema_metadata({"impedance_modules": json.dumps(ABOUT)})
            writer = writer or pq.ParquetWriter(path, table.schema)
            writer.write_table(table)
        if writer is not None:
            writer.close()
        asked = [sys.executable, "-m", "impedance_modules", "diagnose", str(path), "--robot", "baxter"]
        found = measured(asked, Path(folder), 3600.0)
    click.echo(
        f"exit {found['exit']}, {found['seconds']:.0f} s, processor {found['processor_seconds']:.0f} s,"
        f" memory {found['memory_mb']:.0f} MB"
    )


if __name__ == "__main__":
    main()
