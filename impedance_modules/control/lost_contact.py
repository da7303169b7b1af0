# SPDX-License-Identifier: BSD-3-Clause
"""Reports a force axis that pushed against something and then against nothing."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.control.conditions import Touch
from impedance_modules.control.controller import Controller
from impedance_modules.modules.arms import TaskModules
from impedance_modules.spec.task import AXES

Array = NDArray[np.float64]

TOUCHING, LOST = 0.5, 0.2
"""Parts of an axis's force: felt back above the first it touches, below the second it has lost contact."""


@dataclass(frozen=True)
class ForceAxis:
    """A translational axis along which a spring pushes.

    Attributes:
        spring, axis: Names.
        limb: Whose hand pushes.
        share: (3,) direction of the push over its force, world axes [1/N]: minus its product with the force of the
            surroundings is 1 where they resist in full.
    """

    spring: str
    axis: str
    limb: str
    share: Array


class LostContact:
    """Remembers which translational force axes touch."""

    def __init__(self, controller: Controller, touch: Touch) -> None:
        self._controller = controller
        self._touch = touch
        self._touching: set[tuple[str, str]] = set()
        self._modules: TaskModules | None = None
        self._axes: tuple[ForceAxis, ...] = ()

    def look(self) -> list[str]:
        """Returns a sentence for every axis that has lost its contact since the last look."""
        modules = self._controller.modules
        if modules is not self._modules:
            self._modules, self._axes = modules, tuple(_force_axes(modules))
        return [
            f"force axis {axis.axis} of {axis.spring} lost contact"
            for axis in self._axes
            if self._follow((axis.spring, axis.axis), -float(axis.share @ self._touch.felt_by(axis.limb)))
        ]

    def _follow(self, key: tuple[str, str], felt: float) -> bool:
        if felt >= TOUCHING:
            self._touching.add(key)
        elif felt < LOST and key in self._touching:
            self._touching.discard(key)
            return True
        return False


def _force_axes(modules: TaskModules) -> Iterator[ForceAxis]:
    for arm in modules.arms:
        for spring in arm.springs:
            for axis, hybrid in spring.spec.axes.items():
                if axis in AXES[:3] and hybrid.force != 0.0:
                    share = spring.axes[:, AXES.index(axis)] / hybrid.force
                    yield ForceAxis(spring.name, axis, arm.limb.name, share)
