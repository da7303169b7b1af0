# SPDX-License-Identifier: BSD-3-Clause
"""URDFs that were made to harm: encodings, numbers, special files; each refused at its place, with what is valid."""

import codecs
import encodings
import os
import pkgutil
from pathlib import Path

import pytest

from impedance_modules.diagnosis.data.rigid_tree import read_tree
from impedance_modules.errors import BadFile, BadInput
from impedance_modules.spec.located_xml import LARGEST_FILE
from impedance_modules.spec.urdf import MOST_LINKS, read_urdf
from tests.support.paths import SIX_JOINT_PAIR

TEXT = (SIX_JOINT_PAIR / "six_joint_pair.urdf").read_text()
DECLARATION = '<?xml version="1.0"?>'
READ = {"utf_8", "ascii"}
CODECS = sorted({name for _, name, _ in pkgutil.iter_modules(encodings.__path__)} - READ)
NAMES = [
    *CODECS,
    "utf-16",
    "UTF-16LE",
    "ISO-8859-1",
    "latin1",
    "x-unknown",
    "hex",
    "rot13",
    "idna",
    "unicode_escape",
]


def refused(folder: Path, content: str | bytes) -> BadFile:
    path = folder / "robot.urdf"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    with pytest.raises(BadFile) as caught:
        read_urdf(path)
    return caught.value


def replaced(old: str, new: str) -> str:
    assert old in TEXT
    return TEXT.replace(old, new, 1)


def test_no_encoding_but_utf_8_is_read(tmp_path: Path) -> None:
    """Whatever Python, XML or nobody knows under that name: the refusal is the same."""
    for name in NAMES:
        (problem,) = refused(
            tmp_path, replaced(DECLARATION, f'<?xml version="1.0" encoding="{name}"?>')
        ).problems
        assert (problem.line, problem.column) == (1, 1) and problem.valid == ("UTF-8",)
        assert f"the encoding '{name}' is declared" in problem.message
    for name in ("utf-8", "UTF-8", "us-ascii"):
        path = tmp_path / "robot.urdf"
        path.write_text(replaced(DECLARATION, f'<?xml version="1.0" encoding="{name}"?>'))
        assert read_urdf(path).links == read_urdf(SIX_JOINT_PAIR / "six_joint_pair.urdf").links


@pytest.mark.parametrize("codec", ["utf-16", "utf-32", "latin-1", "cp1252"])
def test_bytes_of_another_encoding_are_named_with_their_place(tmp_path: Path, codec: str) -> None:
    text = replaced("<robot ", "<!-- \xe4 --><robot ")
    (problem,) = refused(tmp_path, codecs.encode(text, codec)).problems
    line = 1 if codec.startswith("utf") else text.split("\xe4")[0].count("\n") + 1
    assert "not UTF-8: the byte 0x" in problem.message and problem.line == line


MASS = '<mass value="3.4"/>'
LIMIT = '<limit lower="-1.2" upper="1.8" effort="80" velocity="2.0"/>'
CASES = [
    ('rpy="', 'rpy="inf 0 0" was="', "'rpy' 'inf 0 0' (valid: three finite numbers"),
    ('rpy="', 'rpy="inf" was="', "'rpy' 'inf'"),
    ('xyz="', 'xyz="1" was="', "'xyz' '1' (valid: three finite numbers"),
    ('xyz="', 'xyz="1e308 0 0" was="', "'xyz' '1e308 0 0'"),
    ('xyz="', 'xyz="1_0 0 0" was="', "'xyz' '1_0 0 0'"),
    ('<axis xyz="', '<axis xyz="up" was="', "<axis> has 'xyz' 'up'"),
    ('<axis xyz="', '<axis xyz="0 0 0" was="', "<axis> has no direction"),
    (LIMIT, LIMIT.replace('"80"', '"-80"'), "'effort' '-80' (valid: at least 0)"),
    (LIMIT, LIMIT.replace('"2.0"', '"-2"'), "'velocity' '-2' (valid: at least 0)"),
    (LIMIT, LIMIT.replace('"1.8"', '"-1.8"'), "'lower' -1.2 above 'upper' -1.8"),
    (LIMIT, LIMIT.replace('"1.8"', '"1e308"'), "'upper' '1e308' (valid: at most 1e+18 in size)"),
    (MASS, '<mass value="-1"/>', "'value' '-1' (valid: at least 0)"),
    (MASS, '<mass value="1e999"/>', "'value' '1e999'"),
    ('ixy="', 'ixy="x" was="', "<inertia> needs a finite number 'ixy'; found 'x'"),
    ('<link name="', '<link name="a&#10;b"/><link name="', "control characters in its name"),
]


@pytest.mark.parametrize(("old", "new", "words"), CASES, ids=[case[2][:30] for case in CASES])
def test_numbers_that_nobody_can_compute_with(tmp_path: Path, old: str, new: str, words: str) -> None:
    text = replaced(old, new)
    refusal = refused(tmp_path, text)
    assert words in str(refusal)
    assert text.split(new)[0].count("\n") + 1 in {problem.line for problem in refusal.problems}


def test_a_chain_without_end_is_refused_before_it_is_walked(tmp_path: Path) -> None:
    links = "".join(f'<link name="l{i}"/>' for i in range(MOST_LINKS + 1))
    assert f"{MOST_LINKS + 1} links or joints" in str(refused(tmp_path, f"<robot>{links}</robot>"))


def test_a_chain_of_as_many_links_as_are_allowed_is_walked(tmp_path: Path) -> None:
    links = "".join(f'<link name="l{i}"/>' for i in range(MOST_LINKS))
    joints = "".join(
        f'<joint name="j{i}" type="continuous"><parent link="l{i}"/><child link="l{i + 1}"/></joint>'
        for i in range(MOST_LINKS - 1)
    )
    (tmp_path / "long.urdf").write_text(f"<robot>{links}{joints}</robot>")
    tree = read_tree(tmp_path / "long.urdf", [f"j{MOST_LINKS - 2}"])
    assert tree.joints == (f"j{MOST_LINKS - 2}",)


def test_special_files_are_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "fifo")
    (tmp_path / "large").write_bytes(b" " * (LARGEST_FILE + 1))
    for path, words in [
        (Path("/dev/zero"), "is a device, not a file"),
        (tmp_path / "fifo", "is a FIFO, not a file"),
        (tmp_path, "is a directory, not a file"),
        (tmp_path / "large", f"at most {LARGEST_FILE} are read"),
        (tmp_path / "nothing", "no such file"),
        (tmp_path / ("n" * 300), "cannot be read"),
        (tmp_path / "a\0b", "cannot be read"),
    ]:
        with pytest.raises(BadInput, match=words):
            read_urdf(path)


def test_a_mesh_that_is_a_device_is_refused(tmp_path: Path) -> None:
    mesh = '<collision><geometry><mesh filename="/dev/zero"/></geometry></collision>'
    assert "<mesh> has the file '/dev/zero'" in str(
        refused(tmp_path, replaced(MASS, MASS + "</inertial>" + mesh + "<inertial>"))
    )
