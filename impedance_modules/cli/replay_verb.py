# SPDX-License-Identifier: BSD-3-Clause
"""``impedance replay``: view a recording, or recompute every torque of it."""

from __future__ import annotations

from pathlib import Path

import click

from impedance_modules.cli.plain_lines import say


@click.command("replay")
@click.argument("log", metavar="DIR_OR_LOG", type=click.Path(path_type=Path))
@click.option(
    "--view", is_flag=True, help="Open the recording in the viewer (what happens without --verify)."
)
@click.option("--verify", is_flag=True, help="Recompute every torque; bit-equal on one machine.")
def replay_command(log: Path, view: bool, verify: bool) -> int:
    """Open DIR_OR_LOG in the viewer, or verify it: a run's directory, a folder with one episode, or an episode.

    Exit: 0 fine, 2 no such recording or (with --verify) one without a task, 4 a torque differs.
    """
    from impedance_modules.episode.run_folder import the_episode

    log = the_episode(log)
    if verify:
        _verify(log)
    if view or not verify:
        from impedance_modules.episode.viewer import view_episode

        say(f"opened {view_episode(log)}")
    return 0


def _verify(log: Path) -> None:
    from rich.progress import Progress

    from impedance_modules.cli.terminal import Terminal
    from impedance_modules.episode.reader import read_episode

    episode = read_episode(log)
    console = Terminal()
    with Progress(console=console, transient=True, disable=not console.is_terminal) as bar:
        from impedance_modules.runs.verify import verify

        row = bar.add_task("recomputing", total=1.0)
        found = verify(episode, lambda part: bar.update(row, completed=part))
    say(f"{found.samples} samples of {found.joints} joints recomputed: every torque bit-equal")
    for name, (then, now) in found.other_versions.items():
        say(f"note: recorded with {name} {then}, recomputed with {now}")
