# SPDX-License-Identifier: BSD-3-Clause
r"""Effects all of whose numbers enter nonlinearly: the regression finds the step from a guess.

p = p_0 + \delta p,      r = fixed(p_0) + columns(p_0) \delta p
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from impedance_modules.effects.effect_description import Port
from impedance_modules.effects.effect import Effect, Values
from impedance_modules.effects.recorded_signals import Signals

Array = NDArray[np.float64]


class Stepped(Effect):
    """An effect whose shape is all of its numbers; its coefficients are steps from them."""

    def linear(self, values: Values) -> tuple[Array, dict[str, float]]:
        """The shape says it all."""
        return np.zeros(len(self.shape)), {name: values[name] for name in self.shape}

    def values(
        self, coefficients: Array, shape: Mapping[str, float], signals: Signals, key: str, port: Port
    ) -> dict[str, float]:
        """The shape plus the step."""
        return {name: float(shape[name] + step) for name, step in zip(self.shape, coefficients, strict=True)}
