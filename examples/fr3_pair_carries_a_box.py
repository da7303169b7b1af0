# SPDX-License-Identifier: BSD-3-Clause
"""Two FR3 arms carry a box: a task that names no robot, checked, analysed and run on robots/fr3-pair.

Run: ``python examples/fr3_pair_carries_a_box.py [DIRECTORY]``. With ``backend="mujoco"`` in ``run`` the same task goes
on MuJoCo's physics.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import impedance_modules as im

TASK = Path(__file__).parents[1] / "tasks" / "any-robot" / "carry-box.yaml"


def main(out: Path) -> None:
    """Prints what the box feels like, and where the hands went."""
    task = im.load_task(TASK, robot="fr3-pair")
    forecast = im.check(task)
    print(f"the tank must hold {forecast.tank.need:.2f} J and holds {task.tank.initial:g} J")
    summed = im.analyze(task).object
    print("stiffness at the box, x y z:", np.round(np.diag(summed.stiffness)[:3]), "N/m")
    result = im.run(task, out)
    print("ended:", result.ending.value)
    for hand, path in im.read_episode(result.directory).pose.items():
        print(f"{hand} rose by {1000 * np.ptp(path[:, 2]):.0f} mm")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "out/fr3-pair-carries-a-box"))
