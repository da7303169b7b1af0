# SPDX-License-Identifier: BSD-3-Clause
"""Elements and style of the HTML report: every text is escaped, every plot is inline SVG."""

from __future__ import annotations

import html
import io
from collections.abc import Sequence

import matplotlib as mpl
from matplotlib.figure import Figure

from impedance_modules.errors import printable
from impedance_modules.plain_figures import plain_figure


def text(value: object) -> str:
    """Escapes what must not be read as HTML, and writes control characters out."""
    return html.escape(printable(str(value), lines=True))


def number(value: float | None, digits: int = 4) -> str:
    """Writes a number with some digits; a dash for None."""
    return "-" if value is None else f"{value:.{digits}g}"


def percent(value: float | None) -> str:
    """Writes a share in percent; a dash for None."""
    return "-" if value is None else f"{100.0 * value:.3g} %"


def section(title: str, *parts: str) -> str:
    """A heading with what belongs to it."""
    return f"<section><h2>{text(title)}</h2>{''.join(parts)}</section>"


def paragraph(sentence: str, kind: str = "") -> str:
    """A paragraph of plain text."""
    return f"<p class='{kind}'>{text(sentence)}</p>" if kind else f"<p>{text(sentence)}</p>"


def bullets(sentences: Sequence[str]) -> str:
    """A list of plain texts; nothing where there are none."""
    items = "".join(f"<li>{text(sentence)}</li>" for sentence in sentences)
    return f"<ul>{items}</ul>" if items else ""


def command_lines(commands: Sequence[str]) -> str:
    """Commands to type, a line each; nothing where there are none."""
    lines = "\n".join(text(command) for command in commands)
    return f"<pre class='commands'>{lines}</pre>" if lines else ""


def table(head: Sequence[str], rows: Sequence[Sequence[str]], numbers: Sequence[int] = ()) -> str:
    """A table of plain texts that scrolls on a narrow screen.

    Args:
        head: Titles of the columns.
        rows: Cells.
        numbers: Which columns hold numbers.
    """
    if not rows:
        return ""

    def cells(row: Sequence[str], name: str) -> str:
        kinds = (" class='n'" if index in numbers else "" for index in range(len(row)))
        return "".join(f"<{name}{kind}>{text(cell)}</{name}>" for cell, kind in zip(row, kinds, strict=True))

    body = "".join(f"<tr>{cells(row, 'td')}</tr>" for row in rows)
    top = f"<thead><tr>{cells(head, 'th')}</tr></thead>"
    return f"<div class='wide'><table>{top}<tbody>{body}</tbody></table></div>"


def new_figure(width: float, height: float) -> Figure:
    """A figure of a size [in] whose parts do not overlap."""
    return plain_figure(figsize=(width, height), layout="constrained")


def drawing(figure: Figure, caption: str) -> str:
    """A figure as inline SVG under its caption."""
    buffer = io.StringIO()
    # Text stays text, and the same diagnosis gives the same file.
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "impedance_modules"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    svg = printable(buffer.getvalue(), lines=True)
    svg = svg[svg.index("<svg") :].replace("<svg ", f"<svg role='img' aria-label='{text(caption)}' ", 1)
    return f"<figure>{svg}<figcaption>{text(caption)}</figcaption></figure>"


def gallery(figures: Sequence[str]) -> str:
    """Figures side by side as the width allows."""
    return f"<div class='gallery'>{''.join(figures)}</div>" if figures else ""


BEFORE, AFTER, REFITTED, MEASURED, NOISE = "#d55e00", "#0072b2", "#009e73", "#333333", "#8a8a8a"
"""Nominal model, with the causes, what was recorded, and the noise floor."""

VERDICT_COLOURS = {
    "no_gap": "#00795a",
    "explained": "#00795a",
    "partly_explained": "#a86200",
    "ambiguous": "#a86200",
    "unexplained": "#b3261e",
    "insufficient_data": "#555555",
}
"""Verdict -> colour of its badge."""

STYLE = """
:root{color-scheme:light}
*{box-sizing:border-box}
body{font:16px/1.5 system-ui,sans-serif;color:#1d1d1f;background:#fff;max-width:72rem;margin:0 auto;padding:1rem}
h1{font-size:1.5rem;margin:.5rem 0}
h2{font-size:1.2rem;margin:2rem 0 .5rem;border-bottom:2px solid #e4e4e4;padding-bottom:.2rem}
h3{font-size:1rem;margin:1.2rem 0 .3rem}
.badge{display:inline-block;color:#fff;padding:.25rem .8rem;border-radius:1rem;font-weight:600}
.lead{font-size:1.1rem}
.note{background:#fff6e0;border-left:4px solid #e0a000;padding:.3rem .8rem}
.cards{display:grid;grid-template-columns:repeat(auto-fit,minmax(11rem,1fr));gap:.6rem;margin:1rem 0}
.card{border:1px solid #ddd;border-radius:.5rem;padding:.5rem .8rem}
.card b{display:block;font-size:1.15rem;overflow-wrap:anywhere}
.card span{color:#555;font-size:.85rem}
.gallery{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,24rem),1fr));gap:.8rem}
figure{margin:.5rem 0}
.calm{background:#eef7f3;border-radius:.6rem;padding:.6rem 1.2rem 1rem;margin:1rem 0}
.calm .lead{font-size:1.6rem;font-weight:600;margin:.4rem 0}
.hint{color:#555;font-size:.85rem}
figure svg:focus{outline:2px solid #0072b2;outline-offset:2px}
svg.zoomed{cursor:grab;touch-action:none}
figcaption{color:#555;font-size:.85rem}
svg{max-width:100%;height:auto}
.wide{overflow-x:auto}
table{border-collapse:collapse;font-size:.9rem}
td,th{padding:.25rem .7rem;border-bottom:1px solid #e4e4e4;text-align:left;vertical-align:top}
th{background:#f6f6f6;font-weight:600}
.n{text-align:right;font-variant-numeric:tabular-nums;white-space:nowrap}
pre{overflow:auto;background:#f6f6f6;padding:.8rem;font-size:.8rem;line-height:1.35}
@media print{body{max-width:none;padding:0;font-size:10.5pt}section,figure,tr{break-inside:avoid}
.gallery{grid-template-columns:1fr 1fr}pre{white-space:pre-wrap;overflow:visible}p.hint{display:none}}
"""
