# SPDX-License-Identifier: BSD-3-Clause
"""Diagnosis of a CSV: time, positions, velocities, commanded and measured torques, one row a sample.

Run: ``python examples/diagnose_a_csv.py [DIRECTORY]``. It first records a robot that carries 0.6 kg more than its model
knows, and writes the log as CSV, as another program would. With a log of your own, the lines of ``diagnosed`` suffice;
on the command line: ``impedance diagnose log.csv --map map.yaml --urdf robot.urdf``.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import impedance_modules as im

PATCH = """format: 1
robot: panda
provenance: {origin: hand, date: "2026-11-23"}
effects:
  - effect: payload
    joints: [panda_joint7]
    port: link
    parameters:
      panda_link7:
        m: {value: 0.6, unit: kg}
        cx: {value: 0.0, unit: m}
        cy: {value: 0.0, unit: m}
        cz: {value: 0.2, unit: m}
"""

MAP = """format: 1
robot: panda
joints: [panda_joint1, panda_joint2, panda_joint3, panda_joint4, panda_joint5, panda_joint6, panda_joint7]
effort_source: joint_sensor
gravity_compensation: robot
tables:
  - separator: comma
    header: true
    time: {column: t, unit: s}
    position: {columns: "q {joint}", unit: rad}
    velocity: {columns: "dq {joint}", unit: rad/s}
    effort_command: {columns: "command {joint}", unit: N.m}
    effort: {columns: "torque {joint}", unit: N.m}
"""
"""What the columns mean, where their torques were measured, and who carries the arm's weight (docs/import.md)."""


def recorded(out: Path) -> list[Path]:
    """Records three logs and writes each as CSV."""
    out.mkdir(parents=True, exist_ok=True)
    patch = out / "truth.yaml"
    patch.write_text(PATCH, encoding="utf-8")
    task = im.load_task(Path(__file__).with_name("strokes.yaml"), effects=patch)
    logs = []
    for seed in range(3):
        episode = im.read_episode(im.run(task, out / f"run-{seed}", seed=seed).directory)
        columns = {"t": episode.time}
        for word, of_joint in (("q", episode.position), ("dq", episode.velocity), ("torque", episode.effort)):
            columns |= {f"{word} {joint}": values for joint, values in of_joint.items()}
        columns |= {f"command {joint}": values for joint, values in episode.effort_command.items()}
        logs.append(out / f"log-{seed}.csv")
        rows = np.column_stack(list(columns.values()))
        np.savetxt(logs[-1], rows, delimiter=",", header=",".join(columns), comments="")
    return logs


def diagnosed(logs: list[Path]) -> None:
    """Diagnoses the first logs, tests on the last, prints what was found."""
    meaning = logs[0].with_name("map.yaml")
    meaning.write_text(MAP, encoding="utf-8")
    found = im.diagnose(logs[:-1], robot="panda", holdout=logs[-1:], import_map=meaning)
    print("verdict:", found.verdict)
    for cause in found.causes:
        print(f"{cause.effect} at {', '.join(cause.joints)}:", cause.parameters)
    for gap in found.gaps:
        if gap.shrink is not None and gap.shrink > 0.5:
            print(f"{gap.joint}, {gap.residual}: {gap.before:.3g} to {gap.after:.3g} {gap.unit} with it")


if __name__ == "__main__":
    diagnosed(recorded(Path(sys.argv[1] if len(sys.argv) > 1 else "out/diagnose-a-csv")))
