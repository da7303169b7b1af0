# SPDX-License-Identifier: BSD-3-Clause
"""An edited XML file: what was changed is there, and every other byte is where it was."""

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from impedance_modules.export.edited_xml import EditedXml, number
from impedance_modules.spec.located_xml import read_xml

ODD = """\ufeff<?xml version='1.0' encoding="UTF-8"?>
<!DOCTYPE robot>
<?author me?>
<top\tname = 'caf\u00e9 &amp; "bar"'
     other="it's &lt;" >
  <!-- <a x="1"/> stays -->
  <a x="1" y='2'/><a  x = "3"></a>
  <b>text > &#65; <![CDATA[<a x="9"/>]]>
    <a
      x='4'
    />
\t</b>
  <c x="/>"><d/></c>text/><e/></top>
<!-- end -->
"""
TEXTS = {
    "odd": ODD,
    "windows": ODD.replace("\n", "\r\n"),
    "one line": ODD.replace("\n", " ").replace("\ufeff", ""),
}


def edited(folder: Path, text: str) -> EditedXml:
    path = folder / "file.xml"
    path.write_bytes(text.encode())
    return EditedXml(read_xml(path))


def same(a: ET.Element, b: ET.Element) -> bool:
    """Tags, attributes and elements; text between elements is white space that may be more."""
    alike = a.tag == b.tag and a.attrib == b.attrib and len(a) == len(b)
    return alike and all(same(*both) for both in zip(a, b, strict=True))


@pytest.mark.parametrize("name", TEXTS)
def test_a_file_without_changes_is_the_same_file(name: str, tmp_path: Path) -> None:
    xml = edited(tmp_path, TEXTS[name])
    assert xml.written() == TEXTS[name].encode() and not list(xml.changes())


@pytest.mark.parametrize("name", TEXTS)
@pytest.mark.parametrize("seed", range(30))
def test_random_changes_are_read_back_and_nothing_else_is_touched(
    name: str, seed: int, tmp_path: Path
) -> None:
    source = np.random.default_rng(seed)
    xml = edited(tmp_path, TEXTS[name])
    elements = list(xml.document.root.iter())
    for element in source.choice(np.array(elements, dtype=object), 3):
        for key in [key for key in element.attrib if key != "name" and source.random() < 0.3]:
            del element.attrib[key]
        element.set("x", f"{source.random()} <'&\">")
        if source.random() < 0.5:
            xml.child(xml.add(element, "new", k="1"), "inner").set("z", "caf\u00e9")
    written = xml.written()
    (tmp_path / "again.xml").write_bytes(written)
    again = read_xml(tmp_path / "again.xml")
    assert same(again.root, xml.document.root)
    for kept in (b"<!DOCTYPE robot>", b"<?author me?>", b'<!-- <a x="1"/> stays -->', b"<!-- end -->"):
        assert kept in written
    assert b'&#65; <![CDATA[<a x="9"/>]]>' in written


def test_only_the_value_changes_and_a_new_element_has_a_line_of_its_own(tmp_path: Path) -> None:
    xml = edited(tmp_path, ODD)
    first, second = xml.document.root.findall("a")
    first.set("y", "7")
    second.set("z", "8")
    xml.add(xml.document.root[2], "new")
    xml.add(xml.document.root.find("e"), "new", k="1")
    expected = ODD.replace("y='2'", "y='7'").replace('x = "3"', 'x = "3" z="8"')
    expected = expected.replace("\t</b>", "\t  <new/>\n\t</b>").replace("<e/>", '<e><new k="1"/></e>')
    assert xml.written().decode() == expected


def test_changes_are_listed_in_the_files_order_with_their_lines(tmp_path: Path) -> None:
    xml = edited(tmp_path, ODD)
    del xml.document.root.find("b").find("a").attrib["x"]
    xml.document.root.find("a").set("y", "7")
    xml.add(xml.document.root.find("e"), "new", k="1")
    found = [(change.line, change.key, change.before, change.after) for change in xml.changes()]
    assert found == [(7, "y", "2", "7"), (9, "x", "4", None), (13, "k", None, "1")]
    assert {change.place.split(" of ")[1] for change in xml.changes()} == {"<top> 'caf\u00e9 & \"bar\"'"}


def test_sums_of_decimals_are_decimals_again() -> None:
    assert (number(0.1 + 0.2), number(-0.0), number(1e-20), number(12.0)) == ("0.3", "0", "1e-20", "12")
