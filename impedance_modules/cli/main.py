# SPDX-License-Identifier: BSD-3-Clause
"""The command line: ``impedance VERB``. Parsing, printing and exit codes; the work is done elsewhere.

A verb imports what it needs when it is called: ``check`` must answer without importing a compiler.
"""

from __future__ import annotations

import os
import sys
from importlib import import_module

import click

import impedance_modules
from impedance_modules.cli.plain_lines import say, say_error
from impedance_modules.errors import ImpedanceError
from impedance_modules.installed import EFFECTS, installed

VERBS = {
    "check": "prediction_verbs",
    "analyze": "prediction_verbs",
    "run": "run_verbs",
    "replay": "replay_verb",
    "map": "surface_verbs",
    "import": "import_verb",
    "diagnose": "diagnose_verb",
    "probe": "probe_verb",
    "effects": "effects_verb",
    "patch": "patch_verbs",
    "tune": "tune_verb",
    "sweep": "sweep_verb",
    "roughness": "surface_verbs",
    "robot": "robot_verb",
    "ik": "ik_verb",
    "reproduce": "reproduce_verb",
    "baxter": "baxter",
}
"""Verb -> file of this folder that holds ``VERB_command``; in the order of a session."""

VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


class Verbs(click.Group):
    """Finds a verb's module only when the verb is used."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002 - click's signature
        """Lists the verbs in the order in which they are used."""
        return list(VERBS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        """Imports one verb."""
        if cmd_name not in VERBS:
            return None
        module = import_module(f"impedance_modules.cli.{VERBS[cmd_name]}")
        command: click.Command = getattr(module, f"{cmd_name}_command")
        return command


@click.group(cls=Verbs, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(impedance_modules.__version__, prog_name="impedance")
def impedance() -> None:
    """Impedance tasks for one or two arms: check a task file, run it, replay it, analyse and diagnose it."""


def main() -> None:
    """Runs the command line and ends with the documented exit codes; errors go to stderr, one per line."""
    use_one_thread()
    try:
        if installed(EFFECTS):
            from impedance_modules.effects.catalogue import add_installed_effects

            add_installed_effects()
        code = impedance.main(standalone_mode=False)
    except ImpedanceError as error:
        say_error(error)
        sys.exit(error.exit_code)
    except click.ClickException as error:
        say_error(error)
        sys.exit(2)
    except click.Abort:
        say("stopped by Ctrl-C", err=True)
        sys.exit(130)
    sys.exit(code if isinstance(code, int) else 0)


def use_one_thread() -> None:
    """Keeps numpy's libraries to one thread; must come before numpy is imported.

    On a busy machine their idle threads spin: eigenvalues of a 130x130 loop then take seconds instead of
    milliseconds. A variable that the user has set is left alone.
    """
    for name in VARIABLES:
        os.environ.setdefault(name, "1")
