# SPDX-License-Identifier: BSD-3-Clause
"""Figures in which names are only names: a dollar sign in a joint's name begins no formula."""

from __future__ import annotations

from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure


def plain_figure(**how: Any) -> Figure:
    """Makes a figure whose texts are taken as they are; arguments as of ``Figure``."""
    mpl.rcParams["text.parse_math"] = False  # read when a text is made, so not for this figure alone
    return Figure(**how)
