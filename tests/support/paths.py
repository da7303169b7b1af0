# SPDX-License-Identifier: BSD-3-Clause
"""Where tests find the checkout's folders."""

from __future__ import annotations

from pathlib import Path

TESTS = Path(__file__).parents[1]
CHECKOUT = TESTS.parent
PRESS_BOX = TESTS / "data" / "press-box.yaml"
EVERY_KEY = TESTS / "data" / "every-key.yaml"
SIX_JOINT_PAIR = TESTS / "robots" / "six_joint_pair"
