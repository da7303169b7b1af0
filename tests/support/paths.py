# SPDX-License-Identifier: BSD-3-Clause
"""Where tests find the checkout's folders."""

from __future__ import annotations

import importlib.metadata
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1]
CHECKOUT = TESTS.parent
PRESS_BOX = TESTS / "data" / "press-box.yaml"
EVERY_KEY = TESTS / "data" / "every-key.yaml"
SIX_JOINT_PAIR = TESTS / "robots" / "six_joint_pair"


def robot_descriptions() -> Path:
    """The folder of the descriptions that the package example-robot-data brings; skips the test without it."""
    try:
        package = importlib.metadata.distribution("example-robot-data")
    except importlib.metadata.PackageNotFoundError:
        pytest.skip("the package example-robot-data is not installed")
    return Path(str(package.locate_file("cmeel.prefix/share/example-robot-data/robots")))
