# SPDX-License-Identifier: BSD-3-Clause
"""One HTML file that needs nothing but a browser: verdict, plots, causes, rivals, and the JSON they come from."""

from __future__ import annotations

import html
import io
import json
from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np

from impedance_modules.diagnosis.result import Cause, Diagnosis, Series

matplotlib.use("svg")
from matplotlib.figure import Figure

STYLE = """body{font:15px/1.5 system-ui,sans-serif;max-width:70em;margin:2em auto;padding:0 1em;color:#222}
table{border-collapse:collapse}
td,th{padding:.2em .8em;border-bottom:1px solid #ddd;text-align:left}

td{vertical-align:top}
.verdict{font-size:1.6em;font-weight:600}svg{max-width:100%;height:auto}pre{overflow:auto;background:#f6f6f6;padding:1em}"""


def html_report(found: Diagnosis, answer: dict[str, Any]) -> str:
    """Builds the report; every number in it is in the JSON at its end."""
    parts = [
        "<!doctype html><html lang='en'><meta charset='utf-8'><title>Diagnosis</title>",
        f"<style>{STYLE}</style><h1>Diagnosis of {_text(found.robot)}</h1>",
        f"<p class='verdict'>{_text(found.verdict.replace('_', ' '))}</p><p>{_text(found.reason)}</p>",
        f"<p>Recordings: {_text(', '.join(found.episodes))}.</p>",
        f"<p>Held out: {_text(', '.join(found.heldout) or 'none')}.</p>",
        _warnings(found),
    ]
    if found.gaps:
        parts += [
            "<h2>How large</h2>",
            _gap_table(found),
            "<h2>Before and after, held out</h2>",
            _residuals(found.series),
        ]
        parts += ["<h2>Spectrum</h2>", _spectra(found.series), "<h2>Where</h2>", _where(found)]
    for cause in found.causes:
        parts.append(_cause(cause))
    parts += [
        f"<h2>What is left</h2><p>{_text(found.remainder.structure)}</p>",
        f"<h2>What to record next</h2><p>{_text(json.dumps(dict(found.next_motion)))}</p>",
        f"<h2>The numbers</h2><pre>{_text(json.dumps(answer, indent=1))}</pre></html>",
    ]
    return "\n".join(parts)


def _text(value: str) -> str:
    return html.escape(value)


def _warnings(found: Diagnosis) -> str:
    if found.data is None or not found.data.warnings:
        return ""
    return "<ul>" + "".join(f"<li>{_text(warning)}</li>" for warning in found.data.warnings) + "</ul>"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    top = "".join(f"<th>{_text(cell)}</th>" for cell in head)
    body = "".join("<tr>" + "".join(f"<td>{_text(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table><tr>{top}</tr>{body}</table>"


def _gap_table(found: Diagnosis) -> str:
    rows = [
        [g.joint, g.residual, f"{g.before:.4g}", f"{g.after:.4g}", f"{g.noise_floor:.4g}", g.unit,
         "" if g.shrink is None else f"{100 * g.shrink:.1f} %"]
        for g in found.gaps
    ]  # fmt: skip
    return _table(("joint", "port", "before", "after", "noise", "unit", "shrink"), rows)


def _figure(count: int) -> tuple[Figure, Any]:
    figure = Figure(figsize=(11, 1.5 * count + 0.6), layout="constrained")
    return figure, np.atleast_1d(figure.subplots(count, 1, sharex=True))


def _svg(figure: Figure) -> str:
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None})
    text = buffer.getvalue()
    return text[text.index("<svg") :]


def _residuals(series: Sequence[Series]) -> str:
    figure, axes = _figure(len(series))
    for axis, item in zip(axes, series, strict=True):
        axis.plot(item.time, item.before, color="#c44", linewidth=0.7, label="before")
        axis.plot(item.time, item.after, color="#248", linewidth=0.7, label="after")
        axis.set_ylabel(f"{item.joint}\n{item.residual}", fontsize=7)
    axes[0].legend(loc="upper right", fontsize=7)
    axes[-1].set_xlabel("time [s]")
    return _svg(figure)


def _spectra(series: Sequence[Series]) -> str:
    figure, axes = _figure(len(series))
    for axis, item in zip(axes, series, strict=True):
        step = float(np.median(np.diff(item.time)))
        frequency = np.fft.rfftfreq(len(item.time), step)[1:]
        for values, color in ((item.before, "#c44"), (item.after, "#248")):
            power = np.abs(np.fft.rfft(np.hanning(len(values)) * values))[1:]
            axis.loglog(frequency, power + 1e-12, color=color, linewidth=0.7)
        axis.set_ylabel(f"{item.joint}\n{item.residual}", fontsize=7)
    axes[-1].set_xlabel("frequency [Hz]")
    return _svg(figure)


def _where(found: Diagnosis) -> str:
    joints = list(dict.fromkeys(f"{place.joint} {place.port}" for place in found.where))
    kinds = list(dict.fromkeys(place.regime for place in found.where))
    if not joints:
        return "<p>Nowhere: nothing stands out of the noise.</p>"
    table = np.zeros((len(joints), len(kinds)))
    for place in found.where:
        table[joints.index(f"{place.joint} {place.port}"), kinds.index(place.regime)] += place.share
    figure = Figure(figsize=(8, 0.4 * len(joints) + 1.5), layout="constrained")
    axis = figure.subplots()
    image = axis.imshow(table, cmap="magma_r", aspect="auto")
    axis.set_xticks(range(len(kinds)), kinds)
    axis.set_yticks(range(len(joints)), joints)
    figure.colorbar(image, label="share of the excess power")
    return _svg(figure)


def _cause(cause: Cause) -> str:
    rows = [
        [
            key,
            symbol,
            f"{e.value:.5g}",
            f"{e.value - 1.96 * e.std:.5g} to {e.value + 1.96 * e.std:.5g}",
            e.unit,
        ]
        for key, symbols in cause.parameters.items()
        for symbol, e in symbols.items()
    ]
    rivals = [[r.effect, ", ".join(r.joints), r.reason] for r in (*cause.equivalent, *cause.rivals)]
    alone = "" if cause.shrink is None else f", alone it shrinks the gap by {100 * cause.shrink:.0f} %"
    return (
        f"<h2>{_text(cause.effect)} on {_text(', '.join(cause.joints) or ', '.join(cause.parameters))}</h2>"
        f"<p>At the {_text(cause.port)} port, weight {cause.weight:.2f}{alone}.</p>"
        + _table(("on", "symbol", "value", "95 %", "unit"), rows)
        + "<h3>What else it might be</h3>"
        + _table(("effect", "joints", "why not, or why too"), rivals)
    )
