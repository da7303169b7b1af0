# SPDX-License-Identifier: BSD-3-Clause
"""What a diagnosis writes for people: one HTML file, a recording for the viewer, the terminal's summary."""

import json
import re
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

from impedance_modules.diagnosis.report.diagnosis_files import spectrum_object
from impedance_modules.diagnosis.report.html_elements import number, percent, table
from impedance_modules.diagnosis.report.report_plots import thinned
from impedance_modules.diagnosis.result import ResidualSeries
from impedance_modules.episode.residual_view import ResidualCurves
from impedance_modules.episode.run_folder import episode_paths, the_episode
from impedance_modules.errors import BadInput
from tests.diagnosis import test_diagnosis as pendulum
from tests.support.commands import invoke, python, refusal

SECTIONS = (
    "The data", "How large", "Where", "Causes", "Before and after, over time", "Simulated again", "What is left",
    "What to record next", "Patch", "The numbers",
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


class Page(HTMLParser):
    """Balance of elements, headings, and the cells that hold numbers."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open, self.headings, self.cells, self.links = [], [], [], []
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
    assert "@import" not in text and "url(http" not in text and "<script" not in text
    assert "width=device-width" in text and "@media print" in text
    assert text.count("<svg") >= 7
    patch = (written[0] / "a.yaml").read_text().splitlines()
    assert "lost because" in text and patch[3] in text.replace("&quot;", '"')


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
    item = ResidualSeries("j", "link", "N.m", "run", time, 0.0 * time, tone, 0.5 * tone, ("slow",) * 2000)
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
