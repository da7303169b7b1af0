# SPDX-License-Identifier: BSD-3-Clause
"""One Baxter arm whose hand sways from side to side: a task on which effects show and are compensated."""

SWAYING = """
format: 1
name: sway
robot: baxter
arms:
  right:
    posture: {{s0: 0.4666, s1: -0.7179, e0: 0.3787, e1: 1.5412, w0: -0.3896, w1: 0.8229, w2: 0.2095}}
    joint_bias: {{stiffness: {{s0: 3, s1: 3, e0: 3, e1: 3, w0: 3, w1: 3, w2: 3}}, damping_ratio: 0.7}}
    springs:
      - name: hand
        frame: right_hand
        expressed_in: world
        stiffness: {{x: 300, y: 300, z: 300, rx: 8, ry: 8, rz: 8}}
        damping_ratio: 0.7
safety: {{tank: {{initial: {initial}, max: {most}, floor: 0.3}}}}
phases:
  - name: sway
    equilibrium: {{right.hand: {{y: {{sine: {{amplitude: {amplitude}, frequency: 0.5}}}}}}}}
    duration: {seconds}
"""


def swaying(*, initial: float, most: float, amplitude: float, seconds: float) -> str:
    """Writes the task: energy in the tank at the start and at most [J], amplitude of the hand [m], length [s]."""
    return SWAYING.format(initial=initial, most=most, amplitude=amplitude, seconds=seconds)
