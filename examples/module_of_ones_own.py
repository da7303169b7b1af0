# SPDX-License-Identifier: BSD-3-Clause
"""A module of one's own: a ball that pushes a hand away, summed with the task's springs.

Run: ``python examples/module_of_ones_own.py [DIRECTORY]``. The hand of reach-and-return would pass 2 cm beside the
ball's centre; the ball keeps it off. Its energy counts in the tank like a spring's.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import impedance_modules as im


class Ball:
    """U = k/2 (radius - d)^2 where the frame is nearer than ``radius`` to ``centre``, d their distance; else 0."""

    name = "ball"

    def __init__(
        self, frame: str, centre: np.ndarray, radius: float, stiffness: float, damping: float
    ) -> None:
        self.frame, self.centre, self.radius = frame, centre, radius
        self.stiffness, self.damping = stiffness, damping

    def torque(self, q: np.ndarray, velocity: np.ndarray, kinematics: object) -> im.OwnTorque:
        """-dU/dq = k (radius - d) J^T n, n from the centre to the frame; the damper brakes what comes nearer."""
        jacobian = kinematics.jacobian_of(self.frame)[:3]
        away = kinematics.pose(self.frame).translation - self.centre
        distance = max(float(np.linalg.norm(away)), 1e-6)
        depth, outwards = max(self.radius - distance, 0.0), jacobian.T @ (away / distance)
        approach = max(-float(outwards @ velocity), 0.0) if depth > 0.0 else 0.0
        return im.OwnTorque(
            energy=0.5 * self.stiffness * depth**2,
            spring=self.stiffness * depth * outwards,
            damper=self.damping * approach * outwards,
        )


def main(out: Path) -> None:
    """Runs the task with and without the ball and prints how near the hand came to it."""
    centre = np.array([0.72, -0.28, 0.12])
    ball = Ball("right_hand", centre, radius=0.10, stiffness=400.0, damping=20.0)
    for name, modules in (("without", ()), ("with", (ball,))):
        task = im.load_task("reach-and-return", modules=modules)
        result = im.run(task, out / name, duration=4.0)
        path = im.read_episode(result.directory).pose["right_hand"][:, :3]
        print(f"{name} the ball: {1000 * np.linalg.norm(path - centre, axis=1).min():.0f} mm from its centre")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "out/module-of-ones-own"))
