# SPDX-License-Identifier: BSD-3-Clause
"""A policy leads a hand: asked 50 times a second with what the run reports, it answers with where to go.

Run: ``python examples/policy_streams_set_points.py [DIRECTORY]``. In another process the same goes over a socket:
``impedance run follow-set-points --listen`` and ``impedance_modules.streaming.sender.SetPointSender``.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np

import impedance_modules as im


class Circle:
    """Leads the left hand along a circle of 5 cm, once in four seconds, from where it is when it begins."""

    def __init__(self) -> None:
        self.centre: np.ndarray | None = None
        self.began = 0.0

    def __call__(self, report: im.RunReport) -> dict[str, dict[str, list[float]]]:
        """Says where the hand shall go now; a learned policy would look at ``report`` for more than the time."""
        if self.centre is None:
            self.centre, self.began = report.poses["left_hand"][:3] - [0.05, 0.0, 0.0], report.time
        angle = 0.5 * math.pi * (report.time - self.began)
        place = self.centre + 0.05 * np.array([math.cos(angle), 0.0, math.sin(angle)])
        return {"left.hand": {"position": place.tolist()}}


def main(out: Path) -> None:
    """Runs it for 8 s of the robot's time and prints how far the hand was from where it was led."""
    task = im.load_task("follow-set-points")
    policy = im.PolicySource(Circle(), task.task.set_points, rate=50)
    result = im.run(task, out, duration=8.0, set_points=policy)
    episode = im.read_episode(result.directory)
    apart = np.linalg.norm(episode.pose["left_hand"][:, :3] - episode.target["left_hand"][:, :3], axis=1)
    print(f"{policy.inbox.accepted} set-points accepted, {policy.inbox.refused} refused")
    print(f"the hand moved over {1000 * np.ptp(episode.pose['left_hand'][:, 0]):.0f} mm,")
    print(
        f"{1000 * np.sqrt(np.mean(apart**2)):.1f} mm from where it was led (RMS); {episode.tank[-1]:.2f} J left"
    )


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "out/policy-streams-set-points"))
