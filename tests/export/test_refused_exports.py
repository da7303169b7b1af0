# SPDX-License-Identifier: BSD-3-Clause
"""What cannot be exported is named, all of it at once, with its place and its reason; nothing is written."""

import re
from pathlib import Path

import pytest

from impedance_modules.effects.catalogue import CATALOGUE
from impedance_modules.export.carrier import Format
from impedance_modules.export.mujoco_format import MUJOCO
from impedance_modules.export.urdf_format import URDF
from tests.effects.test_effects_applied import RUNS
from tests.export.test_mujoco_models import UNTURNED, payload
from tests.export.test_urdf_export import ARM, entry
from tests.support.commands import refusal
from tests.support.effect_recordings import applied, write_patch
from tests.support.mujoco_models import mujoco_text, rigid
from tests.support.plant_parts import SIX_JOINTS

# One spring of a joint: a patch with two of them is refused before anything is exported.
EVERY = list({(case.effect, case.port, case.key): case for cases in RUNS.values() for case in cases}.values())
EVERY += [
    applied("surface_height", "contact", "surface0", dh=0.01),
    applied("surface_stiffness", "contact", "surface0", k=9000.0),
    applied("surface_friction", "contact", "surface0", mu=0.4),
    applied("object_inertia", "link", "object", m=0.4),
]
FILES = {"urdf": (URDF, "arm.urdf", ARM), "mujoco": (MUJOCO, "arm.xml", UNTURNED)}
OF_THIS_FILE = {"urdf": set(), "mujoco": {"controller_gain"}}
"""Effects that a format has a place for, and the tests' robot in it has not: its motors are no servos."""

each_format = pytest.mark.parametrize("kind", FILES)


def carried(format_: Format, effect: str, port: str) -> bool:
    parts = [part for part in CATALOGUE[effect].exported if part.acts_at(port)]
    return bool(parts) and all(part.quantity in format_.carriers for part in parts)


@each_format
def test_every_effect_without_a_place_is_named_in_one_message(kind: str, tmp_path: Path) -> None:
    format_, robot = FILES[kind][0], rigid(SIX_JOINTS)
    file, out = tmp_path / "robot.xml", tmp_path / "out.xml"
    file.write_text(robot.urdf.read_text() if kind == "urdf" else mujoco_text(robot))
    patch = write_patch(tmp_path, *(case.entry() for case in EVERY))
    said = refusal("patch", "export", patch, f"--{kind}", file, "--out", out).splitlines()
    lines = patch.read_text().splitlines()
    refused = {index for index, case in enumerate(EVERY) if not carried(format_, case.effect, case.port)}
    named = set()
    for line in said:
        place = re.match(rf"{patch}:(\d+):\d+: effects\[(\d+)\]\.effect: (\w+) cannot become part of", line)
        if place is not None:
            assert place[3] in lines[int(place[1]) - 1] and place[3] == EVERY[int(place[2])].effect
            named.add(int(place[2]))
    assert refused <= named and not out.exists()
    assert {EVERY[index].effect for index in named - refused} == OF_THIS_FILE[kind]


@each_format
def test_every_quantity_is_carried_or_refused_with_a_reason(kind: str) -> None:
    format_ = FILES[kind][0]
    used = {part.quantity for effect in CATALOGUE.values() for part in effect.exported}
    assert used == {*format_.carriers, *format_.refused}
    assert not set(format_.carriers) & set(format_.refused)


def said_of(folder: Path, kind: str, text: str, *entries: dict[str, object], out: str = "out.xml") -> str:
    (folder / "here").mkdir(exist_ok=True)
    file = folder / "here" / FILES[kind][1]
    file.write_text(text)
    patch = write_patch(folder, *entries, robot="arm")
    words = refusal("patch", "export", patch, f"--{kind}", file, "--out", folder / "here" / out)
    assert file.read_text() == text and not (folder / "here" / out).exists()
    return words


FRICTION = entry("viscous_friction", "link", "slide", "N.s/m", fv=0.1)
LATE = entry("command_delay", "timing", "shoulder", "s", T=0.01)
WRIST = entry("viscous_friction", "link", "wrist", "N.s/m", fv=0.1)
BEND = entry("viscous_friction", "link", "shoulder", "N.m.s/rad", fv=0.1)
LIMIT = entry("torque_saturation", "actuator", "turn", "N.m", limit=3.0)
OFFSET = entry("encoder_offset", "sensor", "slide", "m", dq0=0.1)


@pytest.mark.parametrize(
    ("old", "new", "one", "words"),
    [
        ("", "", entry("viscous_friction", "link", "slid", "N.s/m", fv=0.1), "joint 'slid'; did you mean 'slide'?"),
        ("", "", entry("viscous_friction", "link", "slide", "N.m.s/rad", fv=0.1), "fv is in N.s/m, not in"),
        ("", "", payload("armm", 1.0), "'armm' is not one; did you mean 'arm'?"),
        ("", "", LIMIT,
         "arm.urdf:9:1: the joint 'turn' has no <limit>"),
        ('<link name="arm"><inertial><mass value="1"/>', '<link name="arm"><inertial><mass value="0"/>',
         payload("arm", 1.0), "arm.urdf:11:1: the link 'arm' has no <inertial> with mass"),
        ('name="turn"', 'name="slide"', FRICTION, "arm.urdf:9:1: the joint 'slide' is described twice"),
        ("<robot", "<robo", FRICTION, "arm.urdf:12:3: not XML: mismatched tag"),
        ('<axis xyz="1 0 0"/>', '<axis xyz="1 0 0"/><mimic joint="slide"/>', OFFSET,
         "the joint 'turn' follows 'slide' by its true angle"),
    ],
)  # fmt: skip
def test_what_a_urdf_lacks_is_said_at_its_line(
    old: str, new: str, one: dict[str, object], words: str, tmp_path: Path
) -> None:
    assert words in said_of(tmp_path, "urdf", ARM.replace(old, new, 1), one)


@pytest.mark.parametrize(
    ("old", "new", "one", "words"),
    [
        ("", "", entry("viscous_friction", "link", "elbo", "N.m.s/rad", fv=0.1), "joint 'elbo'; did you mean 'elbow'?"),
        ("", "", payload("han", 1.0), "did you mean 'hand'?"),
        ("mujoco", "robot", BEND,
         "arm.xml:1:1: the top element is <robot>; a MuJoCo model begins with <mujoco>; a URDF goes with"),
        ('name="elbow" axis', 'name="shoulder" axis', BEND, "the joint 'shoulder' is described twice"),
        ('name="hand"', 'name="fore"', BEND, "the body 'fore' is described twice"),
        ("<worldbody>", '<include file="x.xml"/><worldbody>', BEND, "arm.xml:13:1: <include> of 'x.xml'"),
        ('<inertial pos="0 0 0.05" mass="0.3" diaginertia="0.002 0.002 0.001"/>', "", payload("hand", 1.0),
         "arm.xml:22:1: the body 'hand' has no <inertial>"),
        ('eulerseq="zyx"', 'inertiafromgeom="true"', payload("hand", 1.0),
         'arm.xml:3:1: <compiler inertiafromgeom="true">'),
        ('diaginertia="0.002 0.002 0.001"', "", payload("hand", 1.0), "neither diaginertia nor fullinertia"),
        (' mass="0.3"', "", payload("hand", 1.0), "arm.xml:23:1: <inertial> has no mass (valid: mass and pos)"),
        ('diaginertia="0.002 0.002 0.001"', 'diaginertia="0.002 0.002"', payload("hand", 1.0), "(valid: 3 numbers)"),
        ('damping="0.5"', 'damping="half"', BEND,
         "arm.xml:6:1: <joint> has 'damping' 'half' (valid: numbers, at most 1e+18 in size)"),
        ('<default class="wrist"', '<default class="wristt"', WRIST,
         "arm.xml:24:1: there is no default class 'wrist'"),
        ('eulerseq="zyx"', 'eulerseq="zq"', payload("upper", 1.0), "in the sequence 'zq' (valid: three of x, y, z)"),
        ("<worldbody>", '<option timestep="0"/><worldbody>', LATE,
         "arm.xml:13:1: <option> has 'timestep' 0 (valid: above 0)"),
        ('name="shoulder" axis', 'name="shoulder" type="ball" axis', BEND, "has no joint 'shoulder'"),
    ],
)  # fmt: skip
def test_what_a_mujoco_model_lacks_is_said_at_its_line(
    old: str, new: str, one: dict[str, object], words: str, tmp_path: Path
) -> None:
    text = UNTURNED.replace('pos="0 0.1 0.2"', 'pos="0 0.1 0.2" euler="1 2 3"')
    assert words in said_of(tmp_path, "mujoco", text.replace(old, new, 2 if old == "mujoco" else 1), one)


def test_a_body_that_cannot_be_is_refused(tmp_path: Path) -> None:
    """Lighter than nothing, of no mass but with moments, and with a moment that no mass has."""
    for symbol, value, unit in (("dm", -1.5, "kg"), ("dm", -1.0, "kg"), ("dIzz", 0.5, "kg.m^2")):
        numbers = {symbol: {"value": value, "unit": unit}}
        for kind, link in (("urdf", "arm"), ("mujoco", "fore")):
            one = {"effect": "link_inertia", "joints": [], "port": "link", "parameters": {link: numbers}}
            assert f"'{link}' by itself is no physical body" in said_of(tmp_path, kind, FILES[kind][2], one)


def test_meshes_must_be_found_from_the_new_file_too(tmp_path: Path) -> None:
    mesh = ARM.replace(
        "</inertial></link>",
        '</inertial><visual><geometry>\n<mesh filename="m.stl"/></geometry></visual></link>',
        1,
    )
    assert "arm.urdf:4:1: <mesh> names the file 'm.stl'" in said_of(
        tmp_path, "urdf", mesh, FRICTION, out="../out.urdf"
    )
    assets = UNTURNED.replace("<worldbody>", '<asset>\n<mesh file="m.stl"/></asset><worldbody>')
    assert "arm.xml:14:1: <mesh> names the file 'm.stl'" in said_of(
        tmp_path, "mujoco", assets, BEND, out="../out.xml"
    )


def test_the_file_that_is_read_is_not_written(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(ARM)
    patch = write_patch(tmp_path, FRICTION, robot="arm")
    for out in (tmp_path / "arm.urdf", patch):
        words = refusal("patch", "export", patch, "--urdf", tmp_path / "arm.urdf", "--out", out)
        assert "that file is read and stays as it is" in words
    assert (tmp_path / "arm.urdf").read_text() == ARM


def test_one_file_to_change_is_needed(tmp_path: Path) -> None:
    patch = write_patch(tmp_path, FRICTION, robot="arm")
    for more in ((), ("--urdf", "a.urdf", "--mujoco", "b.xml")):
        assert "--urdf FILE or --mujoco FILE, one of them" in refusal(
            "patch", "export", patch, *more, "--out", "c"
        )
