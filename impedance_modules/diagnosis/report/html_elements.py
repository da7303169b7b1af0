# SPDX-License-Identifier: BSD-3-Clause
"""A few words of HTML: every text is escaped, every plot is inline."""

from __future__ import annotations

import html
import io
from collections.abc import Sequence

import matplotlib as mpl
from matplotlib.figure import Figure


def text(value: object) -> str:
    """Escapes what must not be read as HTML."""
    return html.escape(str(value))


def number(value: float | None, digits: int = 4) -> str:
    """Writes a number as a reader wants it; a dash where there is none."""
    return "-" if value is None else f"{value:.{digits}g}"


def percent(value: float | None) -> str:
    """Writes a share; a dash where there is none."""
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


def table(head: Sequence[str], rows: Sequence[Sequence[str]], numbers: Sequence[int] = ()) -> str:
    """A table of plain texts that scrolls by itself where the screen is narrow.

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
    """A figure of a size [in] whose parts keep out of each other's way."""
    return Figure(figsize=(width, height), layout="constrained")


def drawing(figure: Figure, caption: str) -> str:
    """A figure as inline SVG under its caption."""
    buffer = io.StringIO()
    # Text stays text, and the same diagnosis gives the same file.
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "impedance_modules"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    svg = buffer.getvalue()
    svg = svg[svg.index("<svg") :].replace("<svg ", "<svg role='img' ", 1)
    return f"<figure>{svg}<figcaption>{text(caption)}</figcaption></figure>"


def gallery(figures: Sequence[str]) -> str:
    """Figures side by side as the width allows."""
    return f"<div class='gallery'>{''.join(figures)}</div>" if figures else ""
