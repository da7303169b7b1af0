# SPDX-License-Identifier: BSD-3-Clause
r"""Lines on the terminal: names that others chose cannot command it, nor pass for lines of ours.

Names of tasks, joints, recordings and files come from anywhere; control characters are written out (ESC as ``\\x1b``).
"""

from __future__ import annotations

import click

from impedance_modules.errors import BadFile, printable

INDENT = "    "
"""Before the further lines of an error that is no list of places in files."""


def say(text: object, *, err: bool = False) -> None:
    """Prints lines of text."""
    click.echo(printable(str(text), lines=True), err=err)


def say_error(error: Exception) -> None:
    """Prints an error to stderr; lines after the first are indented, except of a list of places in files."""
    if isinstance(error, click.ClickException):
        context = error.ctx if isinstance(error, click.UsageError) else None
        if context is not None:
            say(f"{context.get_usage()}\nTry '{context.command_path} --help' for help.\n", err=True)
        say(f"Error: {printable(error.format_message())}", err=True)
        return
    # A name with an end of line in it could pass for the place of another error.
    text = str(error) if isinstance(error, BadFile) else str(error).replace("\n", f"\n{INDENT}")
    say(text, err=True)
