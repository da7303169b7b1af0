# SPDX-License-Identifier: BSD-3-Clause
"""Writes a surface map: a table of its cells, a summary as JSON, and a picture; all of them or none."""

from __future__ import annotations

import csv
import io
import json
import math
import tempfile
from dataclasses import asdict
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from impedance_modules.errors import BadInput
from impedance_modules.plain_figures import plain_figure, plain_powers
from impedance_modules.tools.surface_fit import SurfaceMap, Touches
from impedance_modules.tools.surface_truth import MapErrors, TrueSurface

FILES = ("map.csv", "map.json", "map.png")
RESOLUTION = 120
MILLIMETRES = 1000.0
TWO_SIGMA = 2.0


COLUMNS = (
    "along",
    "x",
    "y",
    "pressed",
    "rest",
    "rest_error",
    "compliance",
    "compliance_error",
    "stiffness",
    "force_low",
    "force_high",
    "blocks",
)
"""Of ``map.csv``: m, m, m, m, m, m, m/N, m/N, N/m, N, N, 1; empty where a cell has too little data."""


def write_map(
    out: Path,
    source: str,
    touches: Touches,
    found: SurfaceMap,
    compared: tuple[TrueSurface, MapErrors] | None,
) -> dict[str, Any]:
    """Writes the files and returns the content of ``map.json``.

    Raises:
        BadInput: The folder holds a map already, or cannot be written.
    """
    present = [name for name in FILES if (out / name).exists()]
    if present:
        raise BadInput(f"{out}: holds {', '.join(present)} already (valid: another --out)")
    summary = _summary(source, touches, found, compared)
    figure = draw_map(found, None if compared is None else compared[0])
    FigureCanvasAgg(figure)
    image = io.BytesIO()
    figure.savefig(image, format="png", dpi=RESOLUTION)
    contents = {
        "map.csv": _table(found, None if compared is None else compared[0]).encode(),
        "map.json": (json.dumps(summary, indent=2, allow_nan=False) + "\n").encode(),
        "map.png": image.getvalue(),
    }
    try:
        out.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=out) as folder:
            for name, content in contents.items():
                (Path(folder) / name).write_bytes(content)
            for name in contents:
                (Path(folder) / name).rename(out / name)
    except OSError as error:
        raise BadInput(f"{out}: the map cannot be written there: {error.strerror}") from error
    return summary


def _table(found: SurfaceMap, truth: TrueSurface | None) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*COLUMNS, *(("true_height", "true_compliance") if truth is not None else ())])
    numbers = (
        found.pressed,
        found.rest,
        found.rest_error,
        found.compliance,
        found.compliance_error,
        found.stiffness,
    )
    for i, along in enumerate(found.along):
        row = [along, *found.place[i], *(values[i] for values in numbers), *found.force[i], found.blocks[i]]
        if truth is not None:
            row += [truth.height[i], truth.compliance[i]]
        writer.writerow(["" if math.isnan(value) else f"{value:.9g}" for value in row])
    return text.getvalue()


def _summary(
    source: str, touches: Touches, found: SurfaceMap, compared: tuple[TrueSurface, MapErrors] | None
) -> dict[str, Any]:
    summary: dict[str, Any] = {
        "format": 1,
        "episode": source,
        "hand": touches.frame,
        "least_force": touches.threshold,
        "origin": found.origin.tolist(),
        "direction": found.direction.tolist(),
        "cell": found.cell,
        "cells": int(found.along.size),
        "cells_with_shape_at_rest": int((found.rest_error >= 0.0).sum()),
        "cells_with_stiffness": int((found.stiffness > 0.0).sum()),
        "units": "m, N, N/m",
    }
    if compared is not None:
        errors = {key: None if math.isnan(value) else value for key, value in asdict(compared[1]).items()}
        summary["errors_against_the_plant"] = errors
    return summary


def draw_map(found: SurfaceMap, truth: TrueSurface | None) -> Figure:
    """Draws shape above, stiffness below, over the position along the stroke.

    Args:
        found: The map.
        truth: What the plant really had, or None.
    """
    figure = plain_figure(figsize=(8.0, 6.4), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    _draw_shape(above, found, truth)
    _draw_stiffness(below, found, truth)
    x, y, _ = found.origin
    below.set_xlabel(
        f"along ({found.direction[0]:.2f}, {found.direction[1]:.2f}) from x = {x:.3f} m, y = {y:.3f} m [mm]"
    )
    for axes in (above, below):
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8)
        axes.spines.top.set_visible(False)
        axes.spines.right.set_visible(False)
    return figure


def _draw_shape(axes: Axes, found: SurfaceMap, truth: TrueSurface | None) -> None:
    along = MILLIMETRES * found.along
    if truth is not None:
        axes.plot(along, MILLIMETRES * truth.height, color="0.3", lw=1.2, label="truth, at rest")
    axes.plot(along, MILLIMETRES * found.pressed, ".", ms=4, color="C1", label="touched: the tactile map")
    axes.errorbar(
        along,
        MILLIMETRES * found.rest,
        TWO_SIGMA * MILLIMETRES * found.rest_error,
        fmt="o",
        ms=3,
        color="C0",
        label="at rest, two standard errors",
    )
    axes.set_ylabel("height [mm]")


def _draw_stiffness(axes: Axes, found: SurfaceMap, truth: TrueSurface | None) -> None:
    along = MILLIMETRES * found.along
    if truth is not None:
        axes.plot(along, 1.0 / truth.compliance, color="0.3", lw=1.2, label="truth")
    relative = found.compliance_error / found.compliance
    axes.errorbar(
        along,
        found.stiffness,
        TWO_SIGMA * relative * found.stiffness,
        fmt="o",
        ms=3,
        color="C0",
        label="stiffness, two standard errors",
    )
    axes.set_yscale("log")
    plain_powers(axes.yaxis)
    axes.set_ylabel("upward stiffness [N/m]")
