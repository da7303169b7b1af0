# SPDX-License-Identifier: BSD-3-Clause
"""``impedance baxter fake``: a simulated Baxter in a process of its own, to practise on."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, TextIO, cast

import click

from impedance_modules.cli.baxter.connection import stop_request
from impedance_modules.cli.plain_lines import say
from impedance_modules.cli.shared_options import effects_option
from impedance_modules.errors import BadInput

if TYPE_CHECKING:
    from impedance_modules.backends.baxter.simulator.parameters import OverTorque, TimeOutResult


@click.command("fake")
@click.option("--robot", default="baxter", show_default=True, metavar="NAME", help="Robot folder.")
@click.option(
    "--posture",
    default="tucked",
    show_default=True,
    metavar="NAME",
    help="Where it stands: tucked, untucked, neutral, or at the start of a task.",
)
@click.option("--enabled", is_flag=True, help="Start with power on; else off, as a real robot does.")
@effects_option
@click.option(
    "--time-out-result",
    type=click.Choice(["hold", "disable", "float"]),
    default="hold",
    show_default=True,
    help="What follows when torque commands stop coming; sources on the real robot disagree.",
)
@click.option(
    "--over-torque",
    type=click.Choice(["clamp", "fault"]),
    default="clamp",
    show_default=True,
    help="What a torque beyond the boards' limit does; nobody has published it.",
)
@click.option("--head-nod", is_flag=True, help="Publish a second head joint, as older software does.")
@click.option("--no-spring", is_flag=True, help="Leave out the shoulders' counterbalance springs.")
@click.option(
    "--software-version", default="1.2.0.57", show_default=True, metavar="V", help="What it says it runs."
)
@click.option(
    "--mount-offset",
    multiple=True,
    metavar="LIMB=X,Y,Z",
    help="Calibrated minus nominal place of an arm's mount [m]; once per limb.",
)
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Of the sensors' noise.")
@click.option(
    "--fault", "faults", multiple=True, metavar="TEXT", help="e.g. '@5 silence' or 'drop 0.2'; see --faults."
)
@click.option("--faults", "list_faults", is_flag=True, help="List every fault and end.")
@click.option(
    "--log",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Write an event log, one JSON line per event.",
)
@click.option("--duration", type=float, metavar="S", help="End after this time  [default: on Ctrl-C].")
def fake(
    robot: str,
    posture: str,
    enabled: bool,
    effects: Path | None,
    time_out_result: str,
    over_torque: str,
    head_nod: bool,
    no_spring: bool,
    software_version: str,
    mount_offset: tuple[str, ...],
    seed: int,
    faults: tuple[str, ...],
    list_faults: bool,
    log: Path | None,
    duration: float | None,
) -> int:
    """Simulate a Baxter: topics, modes and safety functions of the real one, on the built-in plant, in real time.

    Needs a ROS master (roscore), nothing else of ROS. Faults can also be sent as texts to /fake_baxter/fault.

    Exit: 0 ended, 2 bad input or no master.
    """
    import os

    from impedance_modules.backends.baxter.ros.master_client import MasterClient, master_uri_of
    from impedance_modules.backends.baxter.simulator.build_simulator import build_simulator
    from impedance_modules.backends.baxter.simulator.fault_injection import describe, parse_fault
    from impedance_modules.backends.baxter.simulator.parameters import (
        SPRINGS,
        SimulatorOptions,
    )
    from impedance_modules.backends.baxter.simulator.real_time import EventLog, run_in_real_time
    from impedance_modules.backends.baxter.simulator.simulator_node import RosNetwork, SimulatorNode
    from impedance_modules.spec.patch_file import read_patch

    if list_faults:
        say(describe())
        return 0
    if duration is not None and not duration > 0.0:
        raise BadInput(f"--duration {duration:g}: some time is needed (valid: above 0 s)")
    master = master_uri_of(os.environ)
    MasterClient(master, "/impedance_fake").check()
    options = SimulatorOptions(
        time_out_result=cast("TimeOutResult", time_out_result),
        over_torque=cast("OverTorque", over_torque),
        enabled=enabled,
        head_nod=head_nod,
        springs={} if no_spring else SPRINGS,
        software_version=software_version,
        mount_offset=dict(_offset(text) for text in mount_offset),
        seed=seed,
    )
    built = build_simulator(robot, posture, None if effects is None else read_patch(effects), options)
    script = [parse_fault(text, tuple(built.robot.limbs)) for text in faults]
    with ExitStack() as stack:
        log_file = None if log is None else stack.enter_context(_open_log(log))
        asked_to_stop = stack.enter_context(stop_request())
        node = SimulatorNode(built.robot, RosNetwork(master), built.description)
        node.open()
        node.plan(script)
        say(f"a {built.robot.model.spec.name} stands {posture} at {master}; Ctrl-C ends it")
        lag = run_in_real_time(node, EventLog(built.robot, log_file), say, asked_to_stop, duration)
    say(f"ended after {built.robot.now:.1f} s; its clock fell behind by {lag:.3f} s")
    return 0


def _open_log(path: Path) -> TextIO:
    try:
        return path.open("w")
    except OSError as error:
        raise BadInput(f"--log {path}: {error.strerror}") from None


def _offset(text: str) -> tuple[str, tuple[float, float, float]]:
    limb, _, numbers = text.partition("=")
    try:
        x, y, z = (float(number) for number in numbers.split(","))
    except ValueError:
        raise BadInput(f"--mount-offset {text} (valid: LIMB=X,Y,Z in metres)") from None
    return limb, (x, y, z)
