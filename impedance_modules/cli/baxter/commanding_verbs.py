# SPDX-License-Identifier: BSD-3-Clause
"""Verbs of ``impedance baxter`` that command a robot: ``enable``, ``disable`` and ``untuck``.

Nothing else in this package switches motor power on.
"""

from __future__ import annotations

import click

from impedance_modules.cli.baxter.connection import node, robot_option, stop_request, transport_option
from impedance_modules.cli.plain_lines import say


@click.command("enable")
@robot_option
@click.option("--reset", is_flag=True, help="Clear a stop or fault first; it also disables.")
@click.option(
    "--tucked", is_flag=True, help="The arms are tucked: suppress their collision avoidance meanwhile."
)
@transport_option
def enable(robot: str, reset: bool, tucked: bool, transport: str) -> int:
    """Switch motor power on. Stand back, e-stop in hand: the arms hold where they are.

    A robot that fails the preflight checks, or whose arms are outside their ranges, gets no power.

    Exit: 0 enabled, 2 no robot, another one, or it refuses; with the reason.
    """
    from impedance_modules.backends.baxter.power import Power, describe
    from impedance_modules.backends.baxter.preflight_checks import checks_before_power
    from impedance_modules.backends.baxter.session import Session
    from impedance_modules.backends.preflight import refuse_failed
    from impedance_modules.spec.robot_reader import read_robot

    spec = read_robot(robot)
    limbs = tuple(spec.limbs)
    with node(transport, "enable") as found:
        power = Power(found)
        power.wait()
        refuse_failed(
            checks_before_power(Session(found, spec).preflight(limbs), tucked=tucked), commanding=True
        )
        if reset:
            power.reset()
        power.enable(limbs if tucked else ())
        say(describe(power.wait()))
    return 0


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
        say(describe(power.wait()))
    return 0


@click.command("untuck")
@robot_option
@click.option(
    "--to",
    "posture",
    default="untucked",
    show_default=True,
    metavar="NAME",
    help="Where to: untucked, neutral, or the start of a task.",
)
@click.option(
    "--enable",
    is_flag=True,
    help="Switch power on first, with collision avoidance suppressed for tucked arms.",
)
@transport_option
def untuck(robot: str, posture: str, enable: bool, transport: str) -> int:
    """Move both arms slowly to a posture. Everybody out of reach, e-stop in hand.

    Collision avoidance is suppressed during the move where the arms are tucked: then only you keep the arms away
    from things. Ctrl-C holds them where they are.

    Exit: 0 arrived, 2 refused with the reason, 3 stopped on the way, 130 after Ctrl-C.
    """
    from impedance_modules.backends.baxter.position_mode import PostureMover, named_posture
    from impedance_modules.backends.baxter.power import Power
    from impedance_modules.backends.baxter.preflight_checks import checks_before_power
    from impedance_modules.backends.baxter.session import Session
    from impedance_modules.backends.preflight import refuse_failed
    from impedance_modules.spec.robot_reader import read_robot

    spec = read_robot(robot)
    goal = named_posture(spec, posture)
    with node(transport, "untuck") as found, stop_request() as asked_to_stop:
        session = Session(found, spec)
        results = {result.name: result for result in session.preflight(tuple(spec.limbs))}
        tucked = results["range"].passed is False
        if enable:
            refuse_failed(checks_before_power(results.values(), tucked=tucked), commanding=True)
            Power(found).enable(tuple(spec.limbs) if tucked else ())
            results = {result.name: result for result in session.preflight(tuple(spec.limbs))}
        # Tucked arms are outside their ranges; this verb brings them back.
        others = [result for name, result in results.items() if name != "range"]
        refuse_failed(others, commanding=True)
        arrived = PostureMover(session, tucked, asked_to_stop).go(session.model.position(goal))
    say(f"the arms are {posture}" if arrived else "stopped by Ctrl-C; the arms are held")
    return 0 if arrived else 130
