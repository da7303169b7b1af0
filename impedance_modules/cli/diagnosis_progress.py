# SPDX-License-Identifier: BSD-3-Clause
"""The bar of a diagnosis: which stage it is in, and about how long it will still take; on a terminal only."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn
from rich.text import Text

from impedance_modules.diagnosis.diagnose import USUAL_SHARES


def seconds_left(elapsed: float, share: float, since: float) -> float | None:
    """Says how long a diagnosis will still take, if its stages take the usual shares of its time.

    Args:
        elapsed: Seconds until the present stage began.
        share: Usual share of the whole time that has passed by then.
        since: Seconds that the present stage has taken.

    Returns:
        Seconds; None where nothing can be said yet, or the stage takes longer than usual.
    """
    if share <= 0.0:
        return None
    left = elapsed * (1.0 - share) / share - since
    return left if left > 0.0 else None


def share_passed(words: str, before: float) -> float:
    """Usual share of the time that has passed at a sentence; never less than before: stages are repeated."""
    return max(USUAL_SHARES.get(words, 0.0), before)


class TimeLeft(ProgressColumn):
    """Time left, by what the stages until now have taken."""

    def render(self, task: Task) -> Text:
        """Writes it as minutes and seconds; nothing where nothing can be said."""
        began = float(task.fields["began"])
        left = seconds_left(began, task.completed, (task.elapsed or 0.0) - began)
        return Text("" if left is None else f"about {int(left) // 60}:{int(left) % 60:02d} left")


@contextmanager
def diagnosis_progress(console: Console) -> Iterator[Callable[[str], None]]:
    """Shows the stage, a bar and the time left; gives what is to be called with a sentence for each step.

    Sentences that begin no stage (a cause was found) are shown and leave the bar where it is. A stage that is repeated,
    because a cause was taken back, does not move it back.
    """
    if not console.is_terminal:
        yield lambda _: None
        return
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TimeLeft())
    with Progress(*columns, console=console, transient=True) as bar:
        row = bar.add_task("diagnosing", total=1.0, began=0.0)

        def step(words: str) -> None:
            task = bar.tasks[0]
            share = share_passed(words, task.completed)
            if share > task.completed:
                bar.update(row, completed=share, began=task.elapsed or 0.0)
            bar.update(row, description=words)

        yield step
