# SPDX-License-Identifier: BSD-3-Clause
"""Where tests find the checkout's folders."""

from __future__ import annotations

from pathlib import Path

TESTS = Path(__file__).parents[1]
CHECKOUT = TESTS.parent
