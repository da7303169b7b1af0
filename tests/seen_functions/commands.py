# SPDX-License-Identifier: BSD-3-Clause
"""Every verb with every option, shortly; later commands use what earlier ones wrote in the folder that they share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from tests.seen_functions import inputs

CTRL_C = "Ctrl-C"


@dataclass(frozen=True)
class Command:
    """One command.

    Attributes:
        words: After ``impedance``.
        exits: Exit codes that are right.
        meanwhile: What happens as soon as it records: ``CTRL_C``, or a fault of the simulated Baxter.
        recorded_in: The folder whose first part of a recording says that it does.
        says: Text that it must print.
    """

    words: str
    exits: tuple[int, ...] = (0,)
    meanwhile: str = ""
    recorded_in: str = ""
    says: str = ""


@dataclass(frozen=True)
class Section:
    """Commands that belong together.

    Attributes:
        name: For ``--only``.
        commands: In this order.
        prepare: Writes what they read.
        robot: Options of the simulated Baxter that stands meanwhile, if one does.
    """

    name: str
    commands: tuple[Command, ...]
    prepare: Callable[[], None] = lambda: None
    robot: str | None = None


def c(words: str, *exits: int, **more: str) -> Command:
    return Command(words, exits or (0,), **more)


PATCHES = inputs.PATCHES

PREDICTION = (
    c("check press-and-slide"),
    c(f"check soft-hold --effects {PATCHES}/counterbalance-springs.yaml --rate 200 --scale 0.5 --arm right"),
    c("check pair-wipe.yaml"),
    c("check pair-box.yaml"),
    c("check map-sheet"),
    c("check hold-to-pipe"),
    c("check hold-to-saddle"),
    c("check ball.yaml"),
    c("check written.yaml"),
    c("check block.yaml"),
    c("check open.yaml", 2),
    c("check away.yaml", 2, says="meshes there"),
    c("check sand-until-smooth"),
    c("check joint-springs"),
    c("check reach-and-return"),
    c("check peg-compliance"),
    c("check touch-and-stop"),
    c("check one-joint"),
    c("check slide-over-position"),
    c("check forward-path"),
    c("analyze press-and-slide --json analysis.json"),
    c("analyze press-and-slide --phase slide"),
    c("analyze wipe-table-depth --phase lean"),
    c("analyze press-box --phase slide"),
    c("analyze joint-springs"),
    c("analyze arm-stretched"),
    c(f"analyze box-hold --effects {PATCHES}/without-reflected-inertia.yaml"),
    c(f"analyze under-water --effects {PATCHES}/under-water.yaml"),
)

RUNS = (
    c("run short.yaml --out short --seed 3"),
    c("replay short --verify"),
    c("replay short --view", 2),  # no display
    c("run short.yaml --backend replay --log short --out again"),
    c("run short.yaml --arm right --rate 500 --scale 0.5 --read-only --duration 0.2 --out quiet"),
    c("run short.yaml --view --out seen", 2),
    c("run short.yaml --duration 0.1"),
    c("run soft-hold --rate 100 --allow-unstable --duration 0.1 --out unstable", 0, 3),
    c("run unmet.yaml --out unmet", 3),
    c("run long.yaml --out interrupted", 130, meanwhile=CTRL_C, recorded_in="interrupted"),
    c("run press-and-slide --duration 6 --rate 500 --out pressed"),
    c("run box-hold --duration 0.5 --rate 500 --out held"),
    c("run touch-and-stop --rate 500 --out touched"),
    c("run wipe-table --duration 4 --rate 500 --out wiped"),
    c("run peg-compliance --duration 4 --rate 500 --out peg"),
    c("run reach-and-return --rate 200 --out reached"),
    c("run joint-springs --duration 2.5 --rate 250 --out springs"),
    c("run one-joint --duration 3.5 --out wheel"),
    c("run pair-wipe.yaml --duration 1 --out pair"),
    c("run slide-over-position --duration 2 --out played", 0, 3),
    c("run slide-over-position --log played/taught --duration 1 --out played-again", 0, 3),
    c("run slide-over-velocity --duration 1 --out played-by-velocity", 0, 3),
    c("run solved-by-proxsuite.yaml --duration 0.1 --out proxsuite"),
    c("run solved-by-qpsolvers.yaml --duration 0.1 --out qpsolvers"),
)

EFFECTS = (
    c("effects"),
    c("effects payload"),
    c("effects parallel_spring"),
    c("effects surface_height"),
    c("effects object_inertia"),
    *(
        c(f"run pair-hold.yaml --effects {name} --duration 0.1 --out with-{name}", 0, 3)
        for name in inputs.PATCHED
    ),
    c("run pair-wipe.yaml --effects surfaces.yaml --duration 0.2 --out with-surfaces", 0, 3),
)

EXPORT = (
    c("patch export bodies.yaml --urdf small.urdf --out small-patched.urdf"),
    c("patch export bodies.yaml --urdf bare.urdf --out bare-patched.urdf"),
    c("patch export numbers.yaml --mujoco small.xml --out small-patched.xml"),
    *(c(f"patch export fixed.yaml --mujoco {name} --out patched-{name}") for name in inputs.MODELS),
    c("patch export numbers.yaml --urdf small.urdf --out nothing.urdf", 2),
    c("patch export bodies.yaml --mujoco small.xml --out nothing.xml", 2),
    c("patch export numbers.yaml --mujoco small.urdf --out nothing.xml", 2),
    c("patch export bodies.yaml --urdf entity.urdf --out nothing.urdf", 2),
    c("patch export unfit.yaml --mujoco small.xml --out nothing.xml", 2),
    c("patch export bodies.yaml --out nothing", 2),
)

SURFACES = (
    c("run strokes.yaml --rate 200 --out strokes"),
    c("map strokes --out map --truth"),
    c("map strokes --out coarse-map --hand right_hand --force 3 --cell 0.02"),
    c("run fouled.yaml --rate 400 --duration 9 --out fouled"),
    c("map fouled --out fouled-map --truth"),
    c("replay --verify fouled"),
    c("run hold-to-saddle --rate 400 --duration 2 --out saddle"),
    c("run hold-to-pipe --rate 400 --duration 1 --out pipe"),
    c("run sanding.yaml --rate 250 --out sanded", 0, 3),
    c("roughness sanded --windows 2"),
    c(
        "roughness sanded --hand right_hand --along -x --normal z --windows 1 --from 4 --to 14 --json rough.json"
    ),
)

TOOLS = (
    c("tune wipe-table --force 0:25 --direction=-z --out tuned.yaml --json tuned.json"),
    c(
        "tune wipe-table --arm right --force 0:25 --direction=0,0,-1 --alone --reach 2 --softest 0.4 --postures 2"
        " --trial trial.yaml --share 0.95"
    ),
    c(
        "sweep wipe-table --vary environment.0.friction=0.1:0.5:2"
        " --vary arms.right.springs.hand.stiffness.x=200:300:2 --duration 0.1 --rate 250 --jobs 1 --out grid"
    ),
    c(
        f"sweep wipe-table --vary effects.0.parameters.right_hand.m.value=0:0.5 --random 2 --seeds 2 --seed 4"
        f" --effects {PATCHES}/unknown-payload.yaml --duration 0.1 --rate 250 --jobs 1 --keep --out drawn"
    ),
    c("sweep wipe-table --vary environment.0.friction=0.1:0.5:2 --scheduler nowhere://x --out far", 2),
)

IMPORTS = (
    c("import text.csv --map text.yaml --out text"),
    c("import motors.csv --map motors.yaml --out motors"),
    c("import untimed.csv --map untimed.yaml --rate 100 --out untimed"),
    c("import thinned.csv --map thinned.yaml --out thinned"),
    c("import many --map many.yaml --out many-episodes"),
    c("import arrays.mat --map arrays.yaml --out mat"),
    c("import arrays.npz --map arrays.yaml --out npz"),
    c("import arrays.parquet --map columns.yaml --out parquet"),
    c("import slide.csv --map slide.yaml --out slide"),
    c("import wave --out recorder"),
    *(c(f"import {source} --out from-{source}") for source in inputs.BAGS),
    c("import springs.bag --map springs.yaml --out springs"),
    c("import text/text.parquet --out copied"),
    c("import short --out copied-run"),
    c("import damaged.parquet --out saved"),
    c("import text.csv --out nothing", 2),
    c("import uneven.csv --map text.yaml --out nothing", 2),
    c("import zeros.csv --map zeros.yaml --out nothing", 2),
    c("import text.csv --map contradiction.yaml --out nothing", 2),
    *(c(f"import {name}.csv --map {table}.yaml --out nothing", 2) for name, table in inputs.MISTAKEN_LOGS),
    c("import untimed.csv --map untimed.yaml --rate 50 --out nothing", 2),
    c("import untimed.csv --map untimed.yaml --out nothing", 2),
    c("replay text/text.parquet --verify", 2),
    c("replay text/text.parquet", 2),
)

DIAGNOSIS = (
    c(
        "diagnose pendulum/run0.parquet pendulum/run1.parquet pendulum/run2.parquet pendulum/run3.parquet"
        " --holdout pendulum/run4.parquet --urdf pendulum/robot.urdf --json answer.json --report answer.html"
        " --recording answer.rrd --patch answer.yaml --without stribeck_friction",
        *(0, 6),
    ),
    c("diagnose pendulum --urdf pendulum/robot.urdf --effects answer.yaml", 0),
    c("diagnose pendulum --urdf pendulum/robot.urdf --jobs 2", 0, 6),
    c("diagnose pendulum --urdf pendulum/robot.urdf --scheduler nowhere://x", 2),
    c("probe answer.json --urdf pendulum/robot.urdf --out pendulum-next"),
    c("diagnose tone --urdf pendulum/robot.urdf --tolerance 0 --report tone.html --json tone.json", 5),
    c("diagnose tone --urdf pendulum/robot.urdf", 0, 5),
    c("diagnose short-pendulum --urdf pendulum/robot.urdf --json short.json", 7),
    c("probe --robot single_wheel --out first"),
    c("diagnose single --urdf pendulum/robot.urdf", 0, 5, 6, 7),
    c("diagnose table --urdf pendulum/robot.urdf", 0, 5, 6),
    c("diagnose spring --urdf pendulum/robot.urdf --effects answer.yaml", 0, 5, 6),
    c("diagnose stop --urdf pendulum/robot.urdf", 5),
    c("diagnose rich --robot ./robots/noisy_pair --under-water --report rich.html --json rich.json", 0, 5, 6),
    c("diagnose wiped --robot baxter --json wiped.json", 7),
)

EXPERIMENTS = (
    c("reproduce --list"),
    c("reproduce planar-arms --short --seed 2 --out pages --keep kept"),
    c("reproduce planar-arms --full --out full-pages"),
    c("reproduce under-water --short --out pages"),
    c("reproduce one-joint --short --out pages"),
    c("reproduce securing --short --out pages"),
    c("reproduce planar-arm", 2),
)

MISTAKES = (
    *(c(f"check {task}", 2) for task in inputs.BROKEN),
    *(c(f"check {robot}.yaml", 2) for robot in inputs.BROKEN_ROBOTS),
    c("run no-such-task", 2),
    c("run soft-hold --rate 100", 2, says="unstable"),
    c("run short.yaml --arm middle", 2),
    c("run short.yaml --effects nothing.yaml", 2),
    c("run short.yaml --effects broken-patch.yaml", 2),
    c("run short.yaml --effects misplaced-patch.yaml", 2),
    c("check .", 2),
    c("run short.yaml --backend replay", 2),
    c("run short.yaml --fast", 2),
    c("walk", 2),
    c("replay nowhere", 2),
    c("replay short.yaml", 2),
    c("effects payloat", 2),
)

TUCKED = (
    c("baxter check --robot baxter --transport sockets", 2),
    c("baxter state --robot baxter --transport sockets"),
    c("baxter enable --robot baxter --reset --tucked --transport sockets"),
    c("baxter check --transport rospy", 2),
    c("baxter disable --transport sockets"),
)

READY = (
    c("baxter check"),
    c(
        "baxter record --robot baxter --duration 1 --rate 100 --repeat-of other --transport auto"
        " --out listened-{attempt}"
    ),
    c("baxter record --out listened-again-{attempt}", meanwhile=CTRL_C, recorded_in="listened-again-*"),
    c("run soft-hold --backend baxter --read-only --duration 1 --transport auto --out watched-{attempt}"),
    c("run near.yaml --backend baxter --rate 100 --scale 0.4 --approach --duration 1.5 --out real-{attempt}"),
    c("baxter untuck --robot baxter --to soft-hold --enable --transport sockets"),
    c(
        "run soft-hold --backend baxter --rate 100 --scale 0.4 --out ended-{attempt}",
        130,
        meanwhile=CTRL_C,
        recorded_in="ended-*",
    ),
    c(
        "run soft-hold --backend baxter --rate 100 --scale 0.4 --out stopped-{attempt}",
        3,
        meanwhile="estop",
        recorded_in="stopped-*",
        says="e-stop",
    ),
    c("baxter enable", 2),
)

UNFIT = (
    c("baxter check", 2),
    c("baxter state", 2),
    c("baxter untuck", 2),
)

DISTURBED = (
    c("baxter check", 0, 2),
    c("baxter state", 0, 2),
    c("baxter state", 0, 2),
    c("baxter check", 0, 2),
)

SECTIONS = (
    Section("prediction", PREDICTION),
    Section("runs", RUNS),
    Section("effects", EFFECTS, inputs.write_patches),
    Section("export", EXPORT, inputs.write_descriptions),
    Section("surfaces", SURFACES),
    Section("tools", TOOLS),
    Section("imports", IMPORTS, inputs.write_logs),
    Section("diagnosis", DIAGNOSIS, inputs.write_recordings),
    Section("experiments", EXPERIMENTS),
    Section("mistakes", MISTAKES, inputs.write_mistakes),
    Section("baxter tucked", TUCKED, robot="--posture tucked --head-nod --log tucked.jsonl --seed 2"),
    Section(
        "baxter ready",
        READY,
        robot=f"--robot baxter --posture soft-hold --enabled --no-spring --mount-offset right=0.001,0,0"
        f" --effects {PATCHES}/unknown-payload.yaml --time-out-result disable --over-torque fault",
    ),
    Section(
        "baxter unfit",
        UNFIT,
        robot="--posture neutral --enabled --software-version 1.1.1 --duration 60 --fault dead --fault duplicate"
        " --fault partial --fault wrong-md5 --fault nan",
    ),
    Section(
        "baxter disturbed",
        DISTURBED,
        robot="--posture neutral --enabled --fault 'drop 0.1' --fault 'delay 0.02' --fault '@2 clock-step 5'"
        " --fault '@2.2 cuff right' --fault '@2.4 cuff off' --fault '@2.6 push left 0 0 60 0.3' --fault '@3 freeze'"
        " --fault '@3.2 freeze off' --fault '@3.4 restart 0.3' --fault '@4 joint-fault' --fault '@4.3 estop'"
        " --fault '@4.6 estop-release' --fault '@5 partial' --fault '@5.3 silence'",
    ),
    Section("baxter faults", (c("baxter fake --faults"), c("baxter fake --fault estopp", 2))),
)
