# SPDX-License-Identifier: BSD-3-Clause
"""``impedance baxter VERB``: everything that concerns the real robot or the simulated one, besides ``run``."""

from __future__ import annotations

from importlib import import_module

import click

VERBS = {
    "check": "listening_verbs",
    "state": "listening_verbs",
    "enable": "commanding_verbs",
    "disable": "commanding_verbs",
    "untuck": "commanding_verbs",
    "record": "listening_verbs",
    "fake": "simulator_verb",
}
"""Verb -> file of this folder that has a command of that name; in the order of a session."""


class BaxterVerbs(click.Group):
    """Imports a verb's module only when the verb is used."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002 - click's signature
        """Lists the verbs in the order of a session."""
        return list(VERBS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        """Imports one verb."""
        if cmd_name not in VERBS:
            return None
        module = import_module(f"impedance_modules.cli.baxter.{VERBS[cmd_name]}")
        command: click.Command = getattr(module, cmd_name)
        return command


@click.group("baxter", cls=BaxterVerbs)
def baxter_command() -> None:
    """Talk to a Baxter, real or simulated, over ROS 1 (docs/baxter.md). ROS_MASTER_URI and ROS_IP say where it is."""
