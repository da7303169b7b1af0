# SPDX-License-Identifier: BSD-3-Clause
"""An effect of one's own: friction that grows with the cube of the speed, given to the plant and then found again.

Run: ``python examples/effect_of_ones_own.py [DIRECTORY]``. A package adds it for good by an entry point,

    [project.entry-points."impedance_modules.effects"]
    cubic_friction = "my_package.friction:CubicFriction"

and then it is in ``impedance effects``, in patches, on the plant and in every diagnosis.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import impedance_modules as im
from impedance_modules.effects.effect import JointLaw
from impedance_modules.effects.effect_description import Description, Parameter
from impedance_modules.effects.joint_motion import JointSample, Shape

PATCH = """format: 1
robot: panda
provenance: {origin: hand, date: "2026-11-23"}
effects:
  - effect: cubic_friction
    joints: [panda_joint1]
    port: link
    parameters: {panda_joint1: {c: {value: 3.0, unit: N.m.s^3/rad^3}}}
"""


class CubicFriction(JointLaw):
    """tau = c v^3 against the motion."""

    description = Description(
        id="cubic_friction",
        sentence="A torque against the motion that grows with the cube of the speed.",
        equation="tau = c v^3",
        parameters=(Parameter("c", "N.m.s^3/rad^3", "friction", lower=0.0),),
        ports=("actuator", "link"),
        keys=("joint",),
        signature="strong curvature at high speed",
        confusable_with=("quadratic_drag",),
        excitation="several speeds up to the limit",
        reference="none: an example",
        applied="The plant, as a torque at the motor or at the link.",
    )

    def basis(self, sample: JointSample, shape: Shape) -> np.ndarray:
        """The torque per unit of c, (..., 1)."""
        return (sample.velocity**3)[..., None]


def main(out: Path) -> None:
    """Records a robot whose first joint has the effect, diagnoses it, and prints what was found."""
    im.add_effect(CubicFriction())
    out.mkdir(parents=True, exist_ok=True)
    patch = out / "truth.yaml"
    patch.write_text(PATCH, encoding="utf-8")
    task = im.load_task(Path(__file__).with_name("strokes.yaml"), effects=patch)
    logs = [im.run(task, out / f"log-{seed}", seed=seed).directory for seed in range(3)]
    found = im.diagnose(logs[:2], robot="panda", holdout=logs[2:])
    print("verdict:", found.verdict)
    for cause in found.causes:
        print(f"{cause.effect} at {', '.join(cause.joints)}:", cause.parameters)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "out/effect-of-ones-own"))
