# SPDX-License-Identifier: BSD-3-Clause
"""Names that were chosen to harm reach neither the terminal nor a report as anything but text."""

import json
import re
import sys
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from rich.table import Table

from impedance_modules.cli import main as command_line
from impedance_modules.cli.main import VERBS
from impedance_modules.cli.plain_lines import say, say_error
from impedance_modules.cli.terminal import Terminal, styled
from impedance_modules.diagnosis.diagnose import insufficient
from impedance_modules.diagnosis.report.diagnosis_files import diagnosis_object
from impedance_modules.diagnosis.report.html_causes import cause_sections
from impedance_modules.diagnosis.report.html_elements import drawing, new_figure
from impedance_modules.diagnosis.report.html_report import html_report
from impedance_modules.episode.reader import read_episode
from impedance_modules.episode.run_picture import write_picture
from impedance_modules.errors import BadInput, printable
from tests.support.effect_recordings import applied, write_patch
from tests.support.import_logs import base_map, write_map
from tests.support.recordings import columns_of, save

FORGED = "good.yaml:1:1: all is well"
HOSTILE = f"a\x1b[2J\x1b]0;title\x07\x9b31m\u202eb\r\n{FORGED}"
MARKUP = "[/bold][link=http://x]y[/link] <script>alert(1)</script> $\\frac{ <img src=x onerror=y>"
COMMANDS = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")


def assert_harmless(text: str) -> None:
    assert not COMMANDS.search(text), repr(text)
    assert not any(line.startswith(FORGED) for line in text.split("\n")), text


def hostile_file(folder: Path, content: str = "x") -> Path:
    path = folder / HOSTILE.replace("/", "")
    path.write_text(content)
    return path


def hostile_patch(folder: Path) -> Path:
    numbers = {HOSTILE: {HOSTILE: {"value": 1, "unit": HOSTILE}}}
    effect = {"effect": HOSTILE, "joints": [HOSTILE], "port": "link", "parameters": numbers}
    provenance = {"origin": "hand", "date": "2026-11-21"}
    said = {"format": 1, "robot": HOSTILE, "provenance": provenance, "effects": [effect]}
    path = folder / "patch.yaml"
    path.write_text(json.dumps(said))
    return path


HOSTILE_MODEL = """<mujoco><worldbody><body name="b&#x9b;&#x202e;y"/></worldbody></mujoco>"""


def payload_of(folder: Path, link: str) -> Path:
    """A patch that fits the catalogue, for a link of a name."""
    payload = applied("payload", "link", link, m=1.0, cx=0.0, cy=0.0, cz=0.0)
    return write_patch(folder, payload.entry())


def hostile_task(folder: Path) -> Path:
    path = folder / "task.yaml"
    path.write_text(
        json.dumps({"format": 1, "name": HOSTILE, "robot": HOSTILE, HOSTILE: {HOSTILE: [HOSTILE]}})
    )
    return path


CALLS = {
    "check": lambda f: [hostile_task(f), hostile_file(f), HOSTILE],
    "analyze": lambda f: [hostile_task(f), ("soft-hold", "--phase", HOSTILE)],
    "run": lambda f: [hostile_task(f), ("soft-hold", "--effects", hostile_patch(f)), ("soft-hold", "--arm", HOSTILE)],
    "replay": lambda f: [hostile_file(f), (hostile_file(f), "--verify")],
    "map": lambda f: [(hostile_file(f), "--out", f / "o"), (f, "--out", f / "o", HOSTILE)],
    "import": lambda f: [
        (hostile_file(f), "--out", f / "o"),
        (hostile_file(f), "--map", hostile_patch(f), "--out", f / "o"),
        (hostile_file(f, f"t,{HOSTILE}\n1,2\n"), "--map", write_map(f / "m.yaml", base_map()), "--out", f / "o"),
    ],
    "diagnose": lambda f: [(hostile_file(f), "--robot", "baxter"), (f, "--robot", HOSTILE, "--without", HOSTILE)],
    "probe": lambda f: [(hostile_file(f, '{"a": '), "--robot", "baxter", "--out", f / "o")],
    "effects": lambda f: [HOSTILE],
    "patch": lambda f: [
        HOSTILE,
        ("export", hostile_patch(f), "--urdf", hostile_file(f), "--out", f / "o"),
        ("export", payload_of(f, "hand"), "--mujoco", hostile_file(f, HOSTILE_MODEL), "--out", f / "o"),
        ("export", payload_of(f, "b\x9b\u202ey"), "--mujoco", hostile_file(f, HOSTILE_MODEL), "--out", f / "o"),
    ],
    "tune": lambda f: [(hostile_task(f), "--force", "0:1", "--direction", "z"), hostile_task(f)],
    "sweep": lambda f: [
        ("soft-hold", "--vary", f"{HOSTILE}=0:1", "--out", f / "o"),
        (hostile_task(f), "--vary", "a=0:1"),
    ],
    "ik": lambda f: [hostile_task(f), hostile_file(f), HOSTILE],
    "roughness": lambda f: [hostile_file(f)],
    "robot": lambda f: [
        ("new", HOSTILE, "--urdf", hostile_file(f)),
        ("new", "a", "--urdf", hostile_file(f), "--out", f / "o"),
        ("new", "a", "--urdf", hostile_file(f), "--hand", HOSTILE, "--out", f / "o"),
        ("new", "a", "--urdf", hostile_file(f), "--base", HOSTILE, "--out", f / "o"),
        ("new", "a", "--urdf", hostile_file(f), "--hold", HOSTILE, "--out", f / "o"),
    ],
    "reproduce": lambda f: [(HOSTILE, "--out", f / "o")],
    "baxter": lambda f: [("check", "--robot", HOSTILE), HOSTILE],
}  # fmt: skip


@pytest.mark.parametrize("verb", VERBS)
def test_no_verb_lets_a_name_command_the_terminal(verb, tmp_path, monkeypatch, capfd) -> None:
    monkeypatch.delenv("ROS_MASTER_URI", raising=False)
    for words in CALLS[verb](tmp_path):
        given = words if isinstance(words, tuple) else (words,)
        monkeypatch.setattr(sys, "argv", ["impedance", verb, *map(str, given)])
        with pytest.raises(SystemExit) as ended:
            command_line.main()
        said = capfd.readouterr()
        assert ended.value.code == 2 and said.err
        assert_harmless(said.out + said.err)


def test_a_recording_of_hostile_columns_is_refused_by_name(tmp_path) -> None:
    columns = columns_of(np.arange(10.0), ["a"], position=np.zeros((10, 1)))
    with pytest.raises(BadInput, match="has control characters in its name"):
        save(tmp_path, "log", {**columns, f"effort.{HOSTILE}": np.zeros(10)})


def test_what_is_printed_is_text(capsys) -> None:
    table = Table(title=HOSTILE + MARKUP)
    table.add_column(MARKUP)
    table.add_row(HOSTILE + MARKUP)
    Terminal().print(table)
    Terminal().print(HOSTILE + MARKUP)
    Terminal().print(styled("[bold]{}[/bold]: {}", HOSTILE, MARKUP))
    Terminal().rule(HOSTILE + MARKUP)
    say(HOSTILE + MARKUP)
    said = capsys.readouterr()
    assert not COMMANDS.search(said.out), said.out
    assert said.out.count("[/bold][link=http") >= 3


def test_styles_are_rich_s_own(monkeypatch) -> None:
    """On a terminal, colours come through; those of a name do not."""
    monkeypatch.setenv("TERM", "xterm-256color")
    console = Terminal()
    with console.capture() as shown:
        console.print(styled("[bold]{}[/bold]", "a\x1b[31mb"))
    assert "\\x1b[31mb" in shown.get() and "\x1b[31m" not in shown.get()
    assert isinstance(console, Console)


def test_a_place_in_a_file_is_no_picture() -> None:
    assert styled("{}", "a.yaml:100: words").plain == "a.yaml:100: words"


def test_further_lines_of_an_error_are_indented(capsys) -> None:
    say_error(BadInput(f"a file '{HOSTILE}' is bad"))
    assert_harmless(capsys.readouterr().err)


@pytest.mark.parametrize("sign", ["\x00", "\x1b", "\x7f", "\x9b", "\u202e", "\u2066", "\r", "\ud800", "\n"])
def test_signs_that_command_are_written_out(sign) -> None:
    shown = printable(f"a{sign}b")
    assert shown.isascii() and shown.startswith("a\\") and shown.endswith("b")
    assert printable(shown) == shown and printable("a\tb é 中 [x]") == "a\tb é 中 [x]"


class Tags(HTMLParser):
    """Gathers elements and the names of their attributes."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: set[str] = set()
        self.attributes: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.found.add(tag)
        self.attributes |= {name for name, _ in attributes}


def hostile_cause() -> dict[str, object]:
    name = MARKUP + "\x1b[2J"
    estimate = {"value": 1.0, "std": 0.1, "unit": name}
    rival = {"effect": name, "joints": [name], "lost_because": name}
    return {
        "effect": name, "joints": [name], "port": name, "place": name, "weight": 0.5, "shrink": 0.1,
        "equivalent": [rival], "parameters": {name: {name: estimate}}, "rivals": [rival],
        "range": {name: {name: [0.0, 1.0]}}, "rollout": None,
    }  # fmt: skip


def test_a_report_of_hostile_names_holds_no_foreign_element() -> None:
    found = insufficient(MARKUP, [MARKUP, HOSTILE], MARKUP)
    report = html_report(found, diagnosis_object(found), [MARKUP]) + cause_sections([hostile_cause()], 0.5)
    report += drawing(new_figure(1.0, 1.0), f"' onload=alert(1) {MARKUP}")
    tags = Tags(report)
    assert not {"script", "img", "link", "iframe"} & tags.found
    assert not {name for name in tags.attributes if name.startswith("on") or name == "src"}
    assert "&lt;script&gt;alert(1)" in report and "\x1b" not in report and "\\x1b[2J" in report


def test_a_dollar_sign_in_a_name_is_no_formula(tmp_path) -> None:
    time = np.linspace(0.0, 1.0, 50)
    path = save(
        tmp_path,
        "log",
        columns_of(time, ["$\\frac{", "b$x$"], position=np.ones((50, 2)), effort=np.ones((50, 2))),
    )
    episode = read_episode(path)
    assert write_picture(episode, tmp_path / "picture.png").stat().st_size > 1000
