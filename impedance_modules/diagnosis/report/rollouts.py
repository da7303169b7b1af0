# SPDX-License-Identifier: BSD-3-Clause
"""The rollouts in a report: errors by joint, their growth, and the window that the nominal plant misses most."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from impedance_modules.diagnosis.report.html_elements import (
    bullets,
    drawing,
    gallery,
    new_figure,
    number,
    paragraph,
    percent,
    section,
    table,
)
from impedance_modules.diagnosis.report.style import AFTER, BEFORE, MEASURED
from impedance_modules.diagnosis.rollout.outcome import Trace

DRIVEN = {
    "command": "the recorded command",
    "effort": "the effort measured at the link",
    "motor": "the measured motor torque",
}


def rollout_section(rollout: dict[str, Any], traces: Sequence[Trace]) -> str:
    """The whole section; it says so where nothing was rolled out."""
    left_out = bullets([f"{item['what']}: {item['why']}" for item in rollout["left_out"]])
    head = "Simulated again"
    if not rollout["windows"]:
        return section(head, paragraph("No rollout of the plant was made."), left_out)
    floor = "repeats" if rollout["noise_floor_from"] == "repeats" else "the noise of the starts alone (weak)"
    words = (
        f"{rollout['windows']} windows of {number(rollout['window_s'])} s, cut from {', '.join(rollout['episodes'])}."
        f" Each starts from the measured state; {DRIVEN[rollout['driven_by']]} drives the plant."
        f" Noise floor from {floor}."
        f" The gap shrinks by {percent(rollout['shrink'])}."
    )
    missing = f"<h3>Not rolled out</h3>{left_out}" if left_out else ""
    return section(head, paragraph(words), _errors(rollout), gallery(_figures(rollout, traces)), missing)


def _errors(rollout: dict[str, Any]) -> str:
    rows = [
        [joint, quantity, *(number(found[key]) for key in ("before", "after", "noise_floor")), found["unit"],
         percent(found["shrink"])]
        for joint, both in rollout["per_joint"].items()
        for quantity, found in both.items()
    ]  # fmt: skip
    return table(("joint", "of", "before", "after", "noise", "unit", "shrink"), rows, numbers=(2, 3, 4, 6))


def _figures(rollout: dict[str, Any], traces: Sequence[Trace]) -> list[str]:
    growth, figures = rollout["growth"], []
    for trace in traces:
        figure = new_figure(5.5, 2.0)
        over, grown = figure.subplots(1, 2, width_ratios=[3, 2])
        over.plot(trace.time, trace.measured, color=MEASURED, linewidth=2.2, label="measured", alpha=0.6)
        over.plot(trace.time, trace.before, color=BEFORE, linewidth=1.0, label="before")
        over.plot(trace.time, trace.after, color=AFTER, linewidth=1.0, label="after")
        over.set_xlabel(f"time in {trace.episode} [s]", fontsize=8)
        unit = rollout["per_joint"][trace.joint]["position"]["unit"]
        over.set_ylabel(f"position [{unit}]", fontsize=8)
        over.legend(fontsize=7)
        for side, colour in (("before", BEFORE), ("after", AFTER)):
            grown.semilogy(growth["time_s"], growth[side][trace.joint], "o-", color=colour, markersize=3)
        grown.set_xlabel("since the start [s]", fontsize=8)
        grown.set_ylabel(f"rms error [{unit}]", fontsize=8)
        figures.append(
            drawing(
                figure, f"{trace.joint}: the window missed most before, and how errors grow over all windows."
            )
        )
    return figures
