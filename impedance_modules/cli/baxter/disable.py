# SPDX-License-Identifier: BSD-3-Clause
"""``impedance baxter disable``: switches motor power off."""

from __future__ import annotations

import click

from impedance_modules.cli.baxter.connection import node, transport_option


@click.command("disable")
@transport_option
def disable(transport: str) -> int:
    """Switch motor power off. The arms sink: keep the space below them free.

    Exit: 0 disabled, 2 no robot, or it refuses; with the reason.
    """
    from impedance_modules.backends.baxter.power import Power, describe

    with node(transport, "disable") as found:
        power = Power(found)
        power.disable()
        click.echo(describe(power.wait()))
    return 0
