# SPDX-License-Identifier: BSD-3-Clause
"""A spring of the test bench: clamped to a joint's link from outside, unknown to the robot and its maker."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from impedance_modules.effects.effect_description import Description, Parameter, Port
from impedance_modules.effects.effect import JointLaw, Values
from impedance_modules.effects.joint_motion import Sample, Shape
from impedance_modules.effects.recorded_signals import Signals

Array = NDArray[np.float64]


class BenchSpring(JointLaw):
    """k (q - q0) + d v."""

    description = Description(
        id="bench_spring",
        sentence="A damped spring between a link and the bench: a torsion spring, or a clamp if it is stiff.",
        equation="tau = k (q - q0) + d v; the spring's own torque on the joint is -k (q - q0) - d v",
        parameters=(
            Parameter("k", "N.m/rad", "stiffness", lower=0.0, linear_unit="N/m"),
            Parameter("q0", "rad", "angle at which it is relaxed", linear_unit="m"),
            Parameter("d", "N.m.s/rad", "its damping", lower=0.0, left_out="0", linear_unit="N.s/m"),
        ),
        ports=("contact",),
        keys=("joint",),
        signature="linear in the joint's angle, at rest too",
        confusable_with=("parallel_spring", "payload", "torque_offset", "viscous_friction"),
        excitation="a grid of static poses; a single tone cannot tell it from inertia",
        reference="thesis 3.2.1 (figure 3-6)",
        worn="The plant, as a torque on the link; neither the model nor what the robot adds by itself knows it.",
    )

    def basis(self, sample: Sample, shape: Shape) -> Array:
        """Computes q, -1 and v."""
        return np.stack([sample.position, -np.ones_like(sample.position), sample.velocity], axis=-1)

    def bounds(self) -> tuple[Array, Array]:
        """Stiffness and damping are not negative."""
        return np.array([0.0, -np.inf, 0.0]), np.full(3, np.inf)

    def linear(self, values: Values) -> tuple[Array, dict[str, float]]:
        """Coefficients k, k q0 and d."""
        return np.array([values["k"], values["k"] * values["q0"], values.get("d", 0.0)]), {}

    def values(
        self, coefficients: Array, shape: Mapping[str, float], signals: Signals, key: str, port: Port
    ) -> dict[str, float]:
        """The inverse of ``linear``; a spring without stiffness is relaxed anywhere, q0 = 0."""
        k, preload, d = map(float, coefficients)
        return {"k": k, "q0": preload / k if k > 0.0 else 0.0, "d": d}
