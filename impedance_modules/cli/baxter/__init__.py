# SPDX-License-Identifier: BSD-3-Clause
"""``impedance baxter VERB``: everything that concerns the real robot or its double, besides ``run``."""

from __future__ import annotations

import click

VERBS = ("check", "state", "enable", "disable", "untuck", "record", "fake")


class BaxterVerbs(click.Group):
    """Finds a verb's module only when the verb is used."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002 - click's signature
        """Lists the verbs in the order of a session."""
        return list(VERBS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        """Imports one verb."""
        if cmd_name not in VERBS:
            return None
        module = __import__(f"impedance_modules.cli.baxter.{cmd_name}", fromlist=["command"])
        command: click.Command = module.command
        return command


@click.group("baxter", cls=BaxterVerbs)
def command() -> None:
    """Talk to a Baxter, or to its double, over ROS 1 (docs/baxter.md). ROS_MASTER_URI and ROS_IP say where it is."""
