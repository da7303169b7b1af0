# SPDX-License-Identifier: BSD-3-Clause
"""What a diagnosis writes for people: one HTML file, a recording for the viewer, the terminal's summary."""

import base64
import hashlib
import html
import json
import re
import shlex
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from rerun.chunk import RrdReader

from impedance_modules.cli.next_commands import Asked, next_commands
from impedance_modules.diagnosis.diagnose import insufficient
from impedance_modules.diagnosis.gap_result import ResidualSeries
from impedance_modules.diagnosis.model_selection.probability import LAW
from impedance_modules.diagnosis.report.diagnosis_files import diagnosis_object, spectrum_object
from impedance_modules.diagnosis.report.html_causes import cause_sections, likeliest
from impedance_modules.diagnosis.report.html_elements import number, percent, table
from impedance_modules.diagnosis.report.html_report import html_report
from impedance_modules.diagnosis.report.report_plots import thinned
from impedance_modules.diagnosis.result import Grounds
from impedance_modules.episode.residual_view import ResidualCurves
from impedance_modules.episode.run_folder import episode_paths, the_episode
from impedance_modules.errors import BadInput
from tests.diagnosis import test_diagnosis as pendulum
from tests.support.commands import invoke, python, refusal
from tests.support.paths import CHECKOUT

SECTIONS = (
    "The data", "How large", "Where", "Causes", "What the stated deviations took up", "Before and after, over time",
    "Simulated again", "What is left", "What to record next", "Patch",
)  # fmt: skip


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A folder of recordings, diagnosed as a folder, with everything written; and the terminal's words."""
    folder = tmp_path_factory.mktemp("written")
    pendulum.record(folder, "viscous_friction", seconds=8.0)
    (folder / "robot.urdf").write_text(pendulum.URDF)
    files = {"--json": "a.json", "--report": "a.html", "--recording": "a.rrd", "--patch": "a.yaml"}
    options = [word for option, name in files.items() for word in (option, folder / name)]
    return folder, invoke("diagnose", folder, "--urdf", folder / "robot.urdf", *options).output


@pytest.fixture(scope="module")
def calm(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """The same where nothing is wrong but a friction that is too small to matter."""
    folder = tmp_path_factory.mktemp("calm")
    pendulum.record(folder, "little friction")
    (folder / "robot.urdf").write_text(pendulum.URDF)
    files = ["--json", folder / "a.json", "--report", folder / "a.html"]
    return folder, invoke("diagnose", folder, "--urdf", folder / "robot.urdf", *files).output


class Page(HTMLParser):
    """Balance of elements, headings, and the cells that hold numbers."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open, self.headings, self.cells, self.links, self.words = [], [], [], [], []
        self._cell = False
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_startendtag(tag, attrs)
        if tag not in ("meta", "br"):
            self.open.append(tag)
        self._cell = tag == "td" and ("class", "n") in attrs

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.links += [value or "" for name, value in attrs if name in ("src", "href", "xlink:href")]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag
        self._cell = False

    def handle_data(self, data: str) -> None:
        if self._cell:
            self.cells.append(data)
        if self.open and self.open[-1] not in ("script", "style"):
            self.words.append(data)
        if self.open and self.open[-1] == "h2":
            self.headings.append(data)


def numbers(value: object) -> Iterator[float]:
    if isinstance(value, dict):
        # A table's interval is its value and standard deviation in other words.
        if "std" in value and "value" in value:
            yield from (value["value"] - 1.96 * value["std"], value["value"] + 1.96 * value["std"])
        for item in value.values():
            yield from numbers(item)
    elif isinstance(value, list):
        for item in value:
            yield from numbers(item)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield float(value)


def test_the_report_is_whole_and_needs_no_network(written: tuple[Path, str]) -> None:
    text = (written[0] / "a.html").read_text()
    page = Page(text)
    assert page.open == []
    assert tuple(page.headings) == SECTIONS
    assert all(link.startswith(("#", "data:image/png;base64,")) for link in page.links)
    assert "@import" not in text and "url(http" not in text and text.count("<script>") == 1
    assert "width=device-width" in text and "@media print" in text
    assert text.count("<svg") >= 7
    assert "lost because" in text


def test_every_cause_says_how_likely_it_is(written: tuple[Path, str], calm: tuple[Path, str]) -> None:
    """In the JSON, also where it is small, as its schema wants it; by the shipped law; and in the terminal's words."""
    for (folder, printed), part in ((written, "causes"), (calm, "small")):
        answer = json.loads((folder / "a.json").read_text())
        jsonschema.validate(answer, json.loads((CHECKOUT / "schemas/diagnosis.schema.json").read_text()))
        assert answer[part]
        for cause in answer[part]:
            assert cause["probability"] == LAW(Grounds(**cause["grounds"]))
            assert f"{int(100 * cause['probability'])} % likely" in printed


def test_a_report_has_the_likeliest_cause_first(written: tuple[Path, str]) -> None:
    """Whatever its weight, in the summary, the table and the sections; files of older versions go by weight."""
    (cause, *_) = json.loads((written[0] / "a.json").read_text())["causes"]
    three = [
        cause | {"effect": name, "weight": weight, "probability": likely}
        for name, weight, likely in (("first", 0.6, 0.5), ("second", 0.1, 0.9), ("third", 0.3, 0.5))
    ]
    older = [{key: value for key, value in one.items() if key != "probability"} for one in three]
    assert [one["effect"] for one in likeliest(three)] == ["second", "first", "third"]
    assert [one["effect"] for one in likeliest(older)] == ["first", "third", "second"]
    assert "Probability not known" in cause_sections(older, 0.0)
    page = cause_sections(likeliest(three), 0.0)
    assert page.index("second") < page.index("first") < page.index("third")


def test_other_places_of_the_same_effect_are_said(written: tuple[Path, str]) -> None:
    (cause, *_) = json.loads((written[0] / "a.json").read_text())["causes"]
    page = cause_sections([cause | {"place": "drive", "other_places": ["torque_sensor"]}], 0.0)
    assert "cannot tell whether it is at drive or torque sensor" in page
    assert "cannot tell whether" not in cause_sections([cause | {"other_places": []}], 0.0)


RAW = re.compile(r"[{}]|\['|: None|\bNone\b|\bnan\b|array\(|\w+\(\w+=|\"\w+\":")
"""What a data structure of a program looks like: braces, lists of quoted words, Python's words, JSON's keys."""


def test_no_raw_data_structure_is_in_a_page(written: tuple[Path, str], calm: tuple[Path, str]) -> None:
    for folder in (written[0], calm[0]):
        words = "\n".join(Page((folder / "a.html").read_text()).words)
        assert RAW.search(words) is None, RAW.findall(words)


def test_where_nothing_is_wrong_no_shrink_is_printed(
    written: tuple[Path, str], calm: tuple[Path, str]
) -> None:
    shrink = re.compile(r"-?\d+ % *│")
    assert shrink.search(written[1]) and not shrink.search(calm[1])


def test_a_page_without_a_gap_says_so_calmly(calm: tuple[Path, str]) -> None:
    page = Page((calm[0] / "a.html").read_text())
    assert page.open == []
    assert tuple(page.headings) == (
        "What would have been seen", "Too small to matter", "What the stated deviations took up",
        "What is left, over time", "Simulated again", "The data", "What to record next",
    )  # fmt: skip
    words = " ".join(page.words)
    assert "Nothing is wrong." in words and "Nothing is needed." in words
    assert "5 recordings of 2 joints were compared" in words
    assert "coulomb_friction on elbow" in words and "impedance probe" not in words


def test_plots_can_be_zoomed_by_the_pages_own_script_alone(written: tuple[Path, str]) -> None:
    """The policy names the hash of the very script in the page; every plot has what the script changes."""
    text = (written[0] / "a.html").read_text()
    script = text[text.index("<script>") + len("<script>") : text.index("</script>")]
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}'" in text and "default-src 'none'" in text
    assert text.index("Content-Security-Policy") < text.index("<script>")
    assert not re.search(r"\son[a-z]+=", re.sub(r"<script>.*</script>", "", text, flags=re.DOTALL))
    plots = re.findall(r"<svg [^>]*>", text)
    assert len(plots) >= 7 and all("viewBox=" in plot and "aria-label=" in plot for plot in plots)


def test_what_to_record_next_comes_with_its_commands(tmp_path: Path) -> None:
    more = ["--urdf", tmp_path / "robot.urdf", "--hold", "elbow=0.1"]
    asked = Asked((tmp_path,), None, tmp_path / "robot.urdf", ("--hold", "elbow=0.1"), None)
    found = next_commands(asked, {"purpose": "tell payload, torque_gain apart", "joints": ["elbow"]})
    first, second, third = (shlex.split(command) for command in found)
    assert first == ["impedance", "diagnose", str(tmp_path), *map(str, more), "--json", "answer.json"]
    assert second[:3] == ["impedance", "probe", "answer.json"]
    assert third[:2] == ["impedance", "diagnose"] and "--hold" in third
    assert next_commands(asked, {"purpose": "none needed"}) == ()
    short = insufficient("robot", ["run"], "too short")
    page = html_report(short, diagnosis_object(short), found)
    assert all(html.escape(command) in page for command in found)
    run = Asked((Path("a b.parquet"),), "baxter", None, (), Path("x.json"))
    probe, record, diagnose = next_commands(run, {"purpose": "tell a cause at all"})
    assert probe == "impedance probe x.json --robot baxter --out probe"
    assert record == "impedance run probe/probe.yaml --out runs/probe"
    assert diagnose == "impedance diagnose 'a b.parquet' runs/probe --robot baxter --json x.json"


def test_every_number_in_a_table_of_the_report_is_in_the_json(written: tuple[Path, str]) -> None:
    known = set()
    for value in numbers(json.loads((written[0] / "a.json").read_text())):
        known |= {number(value, digits) for digits in (2, 4, 5)} | {percent(value), f"{value:.3g}"}
    cells = [cell for cell in Page((written[0] / "a.html").read_text()).cells if cell != "-"]
    assert len(cells) > 30
    for cell in cells:
        assert all(part in known for part in cell.split(" to ")), cell


def test_the_recording_holds_measured_predicted_residuals_and_regimes(written: tuple[Path, str]) -> None:
    path = written[0] / "a.rrd"
    assert python("-m", "rerun", "rrd", "verify", str(path)).returncode == 0
    paths = RrdReader(str(path)).store().schema().entity_paths()
    (tested,) = json.loads((written[0] / "a.json").read_text())["data"]["heldout"]
    for joint in pendulum.JOINTS:
        for kind in ("signals", "residuals"):
            assert f"/{kind}/{tested}/link/{joint}" in paths
        assert f"/regimes/{tested}/{joint}" in paths


def test_the_terminal_shows_gap_rollouts_and_cause(written: tuple[Path, str]) -> None:
    for words in ("held-out residual", "simulated again", "viscous_friction", "remainder"):
        assert words in written[1]


def test_a_folder_means_its_episodes_and_is_replayed_if_there_is_one(written, tmp_path: Path) -> None:
    names = [path.name for path in episode_paths([written[0]])]
    assert names == [f"run{index}.parquet" for index in range(5)]
    assert "holds 5 episodes" in refusal("replay", written[0], "--verify")
    with pytest.raises(BadInput, match="no episode here"):
        episode_paths([tmp_path])
    (tmp_path / "only.parquet").write_bytes((written[0] / "run0.parquet").read_bytes())
    assert the_episode(tmp_path) == tmp_path / "only.parquet"


def test_texts_cannot_become_html() -> None:
    assert "<b>" not in table(("<b>",), [["<b>joint</b>"]])


def test_thinning_loses_no_peak() -> None:
    values = np.random.default_rng(1).normal(size=70_000)
    values[[777, 50_001]] = 40.0, -40.0
    time, drawn = thinned(np.arange(70_000.0), values)
    assert len(drawn) < 3000 and drawn.max() == 40.0 and drawn.min() == -40.0
    assert np.all(np.diff(time) >= 0.0)


def test_octaves_add_up_to_the_whole() -> None:
    time = np.arange(2000) / 50.0
    tone = np.sin(2.0 * np.pi * 3.0 * time)
    item = ResidualSeries(
        "j", "link", "N.m", "run", time, 0.0 * time, tone, 0.5 * tone, 0.1 * tone, ("slow",) * 2000
    )
    found = spectrum_object([item])
    before, after = (np.array(found["per_port"][0][side]) for side in ("before", "after"))
    assert np.sqrt(np.sum(before**2)) == pytest.approx(np.sqrt(0.5), rel=0.02)
    assert found["edges_hz"][int(before.argmax())] == 2.0
    np.testing.assert_allclose(after, 0.5 * before)


def test_what_is_predicted_and_its_residual_make_what_was_measured() -> None:
    numbers = np.zeros(1), np.ones(1), np.ones(1), np.ones(1)
    item = ResidualCurves("run 1", "link", "j/1", "N.m", *numbers, ("hold",))
    signals, residuals = item.paths
    assert signals != residuals and re.fullmatch(r"/signals/run.*/link/j/1", signals)
