# SPDX-License-Identifier: BSD-3-Clause
"""``impedance baxter enable``: the only verb that switches motor power on."""

from __future__ import annotations

import click

from impedance_modules.cli.baxter.connection import node, robot_option, transport_option


@click.command("enable")
@robot_option
@click.option("--reset", is_flag=True, help="Clear a stop or fault first; it also disables.")
@click.option("--tucked", is_flag=True, help="The arms are tucked: suppress their force field meanwhile.")
@transport_option
def enable(robot: str, reset: bool, tucked: bool, transport: str) -> int:
    """Switch motor power on. Stand back, e-stop in hand: the arms hold where they are.

    A robot that is not the one we mean, or stands outside its ranges, gets no power.

    Exit: 0 enabled, 2 no robot, another one, or it refuses; with the reason.
    """
    from impedance_modules.backends.baxter.power import Power, describe
    from impedance_modules.backends.baxter.preflight_checks import before_power, refuse_closed
    from impedance_modules.backends.baxter.session import Session
    from impedance_modules.spec.robot_reader import read_robot

    spec = read_robot(robot)
    limbs = tuple(spec.limbs)
    with node(transport, "enable") as found:
        power = Power(found)
        power.wait()
        refuse_closed(before_power(Session(found, spec).gates(limbs), tucked=tucked), commanding=True)
        if reset:
            power.reset()
        power.enable(limbs if tucked else ())
        click.echo(describe(power.wait()))
    return 0
