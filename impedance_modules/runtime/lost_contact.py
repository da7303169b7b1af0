# SPDX-License-Identifier: BSD-3-Clause
"""Reports a force axis that pushed against something and then against nothing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impedance_modules.runtime.conditions import Touch
from impedance_modules.runtime.controller import Controller
from impedance_modules.spec.task import AXES

Array = NDArray[np.float64]

TOUCHING, LOST = 0.5, 0.2
"""Parts of an axis's force: felt back above the first it touches, below the second it has lost contact."""


class LostContact:
    """Remembers which translational force axes touch."""

    def __init__(self, controller: Controller, touch: Touch) -> None:
        self._controller = controller
        self._touch = touch
        self._touching: set[tuple[str, str]] = set()

    def look(self) -> list[str]:
        """Returns a sentence for every axis that has lost its contact since the last look."""
        lost: list[str] = []
        for arm in self._controller.modules.arms:
            pushing = [spring for spring in arm.springs if spring.hybrid]
            if not pushing:
                continue
            force = self._touch.felt_by(arm.limb.name)
            for spring in pushing:
                for axis, hybrid in spring.spec.axes.items():
                    if axis in AXES[:3] and hybrid.force != 0.0:
                        direction = spring.axes[:, AXES.index(axis)] * np.sign(hybrid.force)
                        felt = -float(direction @ force) / abs(hybrid.force)
                        if self._follow((spring.name, axis), felt):
                            lost.append(f"force axis {axis} of {spring.name} lost contact")
        return lost

    def _follow(self, key: tuple[str, str], felt: float) -> bool:
        if felt >= TOUCHING:
            self._touching.add(key)
        elif felt < LOST and key in self._touching:
            self._touching.discard(key)
            return True
        return False
