# SPDX-License-Identifier: BSD-3-Clause
"""A loop of one's own on MuJoCo: the loop steps the physics and reads the joints, the package gives the torques.

Run: ``python examples/own_loop_on_mujoco.py``, with the package's extra ``mujoco``. Nothing is recorded, and nobody but
this loop decides when a torque acts: here, as the robot's file says, one period after the state that it answers.
"""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np

from impedance_modules.backends.mujoco.assembled_plant import mujoco_plant
from impedance_modules.backends.protocol import FirstState
from impedance_modules.control.assembly import assemble
from impedance_modules.control.supervisor import Supervisor
from impedance_modules.plant.plant import PlantOptions
from impedance_modules.robot.state import RobotState

TASK = Path(__file__).with_suffix(".yaml")


def main() -> Supervisor:
    """Carries the task out and prints where the hands are; returns the supervisor, which knows how it ended."""
    assembly = assemble(str(TASK), effects=None, rate=1000.0, scale=1.0, arm=None)
    model, posture = assembly.model, assembly.modules.posture
    # Any MjModel with the robot's joints will do; this one is made of the robot's folder.
    scene = mujoco_plant(model, assembly.task, posture, PlantOptions(rate=1000.0, seed=0)).scene
    physics, joints = scene.compiled, scene.indices
    data = mujoco.MjData(physics)
    data.qpos[joints.position] = posture
    steps = round(assembly.period / physics.opt.timestep)

    def measured(time: float) -> RobotState:
        """What the joints report: position, velocity, and the torque of their drives."""
        at = joints.velocity
        drives = data.qfrc_actuator[at] + data.qfrc_applied[at]
        return RobotState(time, data.qpos[joints.position], data.qvel[at], drives)

    # The task's torques leave the arms' weight to the robot: here that is this loop, from before the start.
    data.qfrc_applied[joints.velocity] = model.gravity(posture)
    supervisor, on_its_way, cycle = Supervisor(assembly), np.zeros(model.n), 0
    supervisor.start(FirstState(measured(0.0), on_its_way))
    while supervisor.ending is None:
        state = measured(cycle * assembly.period)
        effort = supervisor.step(state, late=False, stop_request=None)
        supervisor.look()
        data.qfrc_applied[joints.velocity] = on_its_way + model.gravity(state.position)
        on_its_way = np.zeros(model.n) if effort is None else effort.copy()
        mujoco.mj_step(physics, data, steps)
        cycle += 1
        if cycle % 500 == 0:
            hands = [model.pose(state.position, limb.hand).translation for limb in model.limbs.values()]
            print(f"{cycle * assembly.period:.1f} s  {supervisor.sequence.phase.name:8}", *np.round(hands, 3))
    print(supervisor.ending.value)
    return supervisor


if __name__ == "__main__":
    main()
