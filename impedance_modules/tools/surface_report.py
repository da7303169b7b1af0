# SPDX-License-Identifier: BSD-3-Clause
"""Writes a map: a table of its cells, what it is, and a picture; all of them or none."""

from __future__ import annotations

import csv
import io
import json
import math
import tempfile
from dataclasses import asdict
from pathlib import Path
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg

from impedance_modules.errors import BadInput
from impedance_modules.tools.surface_map.picture import draw_map
from impedance_modules.tools.surface_fit import SurfaceMap
from impedance_modules.tools.surface_map.touches import Touches
from impedance_modules.tools.surface_truth import MapErrors, TrueSurface

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
"""Of ``map.csv``: m, m, m, m, m, m, m/N, m/N, N/m, N, N, 1; empty where a cell does not tell."""

FILES = ("map.csv", "map.json", "map.png")
RESOLUTION = 120


def write_map(
    out: Path, source: str, touches: Touches, found: SurfaceMap, compared: tuple[TrueSurface, MapErrors] | None
) -> dict[str, Any]:
    """Writes the files and returns what ``map.json`` says.

    Raises:
        BadInput: The folder holds a map already, or cannot be written.
    """
    present = [name for name in FILES if (out / name).exists()]
    if present:
        raise BadInput(f"{out}: holds {', '.join(present)} already (valid: another --out)")
    said = _summary(source, touches, found, compared)
    figure = draw_map(found, None if compared is None else compared[0])
    FigureCanvasAgg(figure)
    image = io.BytesIO()
    figure.savefig(image, format="png", dpi=RESOLUTION)
    contents = {
        "map.csv": _table(found, None if compared is None else compared[0]).encode(),
        "map.json": (json.dumps(said, indent=2, allow_nan=False) + "\n").encode(),
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
    return said


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
    said: dict[str, Any] = {
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
        said["errors_against_the_plant"] = errors
    return said
