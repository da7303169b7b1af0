# SPDX-License-Identifier: BSD-3-Clause
"""Figures in which names are only names: a dollar sign in a joint's name begins no formula."""

from __future__ import annotations

from typing import Any

import matplotlib as mpl
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter


def plain_figure(**how: Any) -> Figure:
    """Makes a figure whose texts are taken as they are; arguments as of ``Figure``."""
    mpl.rcParams["text.parse_math"] = False  # read when a text is made, so not for this figure alone
    return Figure(**how)


def plain_powers(axis: Axis) -> None:
    """Writes numbers along a logarithmic axis as they are: powers of ten would be formulas, and those are off."""
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())
