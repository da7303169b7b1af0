# SPDX-License-Identifier: BSD-3-Clause
r"""Tables and styled text on the terminal, in which names that others chose command nothing.

Control characters are written out (ESC as ``\x1b``), and square brackets are text, not styles. ``plain_lines`` is the
same for lines without styles.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.segment import Segment
from rich.text import Text

from impedance_modules.errors import printable


class Terminal(Console):
    """Prints tables and styled texts; strings are taken as they are."""

    def __init__(self, *, highlight: bool = True) -> None:
        super().__init__(markup=False, emoji=False, highlight=highlight)

    def render(self, *arguments: Any, **options: Any) -> Iterable[Segment]:
        """Renders as usual, then writes control characters out; styles and movements of the cursor are rich's own."""
        for segment in super().render(*arguments, **options):
            yield segment if segment.control else segment._replace(text=printable(segment.text, lines=True))


def styled(template: str, *values: object) -> Text:
    """Fills values into a text with styles: ``styled("[bold]{}[/bold]: {}", name, words)``."""
    return Text.from_markup(
        template.format(*(escape(printable(str(value))) for value in values)), emoji=False
    )
