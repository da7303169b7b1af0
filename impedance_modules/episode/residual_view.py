# SPDX-License-Identifier: BSD-3-Clause
"""A rerun recording of measured against predicted: curves, residuals and what each joint did."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from impedance_modules.arrays import Array
from impedance_modules.episode import view_layout
from impedance_modules.episode.rerun_writer import open_stream, send_curves, send_layout, time_index

MEASURED, BEFORE, AFTER = (90, 90, 90, 255), (213, 94, 0, 255), (0, 114, 178, 255)
"""Colours of what was recorded, of the nominal model, and of the model with the causes."""

CLOSING_TIMEOUT = 60.0
"""How long writing the file may take [s]."""


@dataclass(frozen=True, eq=False)
class ResidualCurves:
    """One joint at one port in one recording.

    Attributes:
        episode: The recording.
        port: Which comparison.
        joint: Name.
        unit: Of the values.
        time: (M,) [s].
        measured: (M,) what was recorded.
        before, after: (M,) residual of the nominal model, and of the one with the causes.
        regimes: What the joint does at each sample.
    """

    episode: str
    port: str
    joint: str
    unit: str
    time: Array
    measured: Array
    before: Array
    after: Array
    regimes: tuple[str, ...]

    @property
    def paths(self) -> tuple[str, str]:
        """Entities of the signals and of the residuals."""
        place = (self.episode, self.port, self.joint)
        return view_layout.entity("signals", *place), view_layout.entity("residuals", *place)

    @property
    def regime_path(self) -> str:
        """Entity of what the joint does."""
        return view_layout.entity("regimes", self.episode, self.joint)


def write_residual_curves(path: Path, comparisons: Sequence[ResidualCurves], name: str) -> Path:
    """Writes all comparisons as one recording; each one's time is its own recording's.

    Args:
        path: Of the ``.rrd`` file; replaced if there.
        comparisons: Of one or more recordings.
        name: Of the recording, as the viewer lists it.

    Raises:
        OSError: The file cannot be written.
    """
    stream = open_stream(path, name)
    regimes_of: set[str] = set()
    for item in comparisons:
        _write_curves(stream, item)
        if item.regime_path not in regimes_of:
            regimes_of.add(item.regime_path)
            _write_regimes(stream, item)
    send_layout(stream, _layout(comparisons))
    stream.flush(timeout_sec=CLOSING_TIMEOUT)
    stream.disconnect()
    return path


def _write_curves(stream: rr.RecordingStream, item: ResidualCurves) -> None:
    signals, residuals = item.paths
    names = ["measured", "predicted before", "predicted after"]
    stream.log(signals, rr.SeriesLines(names=names, colors=[MEASURED, BEFORE, AFTER]), static=True)
    stream.log(residuals, rr.SeriesLines(names=["before", "after"], colors=[BEFORE, AFTER]), static=True)
    index = time_index(item.time)
    predicted = [item.measured - residual for residual in (item.before, item.after)]
    send_curves(stream, signals, index, np.column_stack([item.measured, *predicted]))
    send_curves(stream, residuals, index, np.column_stack([item.before, item.after]))


def _write_regimes(stream: rr.RecordingStream, item: ResidualCurves) -> None:
    """Writes each change of what the joint does."""
    last = None
    for time, regime in zip(item.time, item.regimes, strict=True):
        if regime != last:
            stream.set_time(view_layout.TIMELINE, duration=float(time))
            stream.log(item.regime_path, rr.StateChange(state=regime))
            last = regime


def _layout(comparisons: Sequence[ResidualCurves]) -> rrb.Blueprint:
    """One tab per recording and port: signals beside residuals, joint by joint, regimes below."""
    tabs = [
        _tab(name, [item for item in comparisons if (item.episode, item.port) == name])
        for name in dict.fromkeys((item.episode, item.port) for item in comparisons)
    ]
    return rrb.Blueprint(
        rrb.Tabs(*tabs),
        rrb.TimePanel(timeline=view_layout.TIMELINE, state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        auto_views=False,
    )


def _tab(name: tuple[str, str], items: Sequence[ResidualCurves]) -> Any:
    views = list(_pairs(items))
    regimes = rrb.StateTimelineView(
        origin="/", contents=[item.regime_path for item in items], name="what each joint does"
    )
    grid = rrb.Grid(*views, grid_columns=2)
    return rrb.Vertical(grid, regimes, row_shares=[max(3, len(items)), 1], name=f"{name[1]} in {name[0]}")


def _pairs(items: Sequence[ResidualCurves]) -> Iterator[Any]:
    for item in items:
        titles = (
            f"{item.joint}: measured and predicted [{item.unit}]",
            f"{item.joint}: residual [{item.unit}]",
        )
        for path, title in zip(item.paths, titles, strict=True):
            yield rrb.TimeSeriesView(
                origin="/",
                contents=[path],
                name=title,
                axis_x=rrb.TimeAxis(link=rrb.components.LinkAxis.LinkToGlobal),
                plot_legend=rrb.PlotLegend(visible=True),
            )
