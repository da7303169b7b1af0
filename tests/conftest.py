# SPDX-License-Identifier: BSD-3-Clause
"""Options for machines: a skipped test is a failed run, and of long tests a seeded sample runs. A ROS master."""

from __future__ import annotations

import secrets
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import settings

from tests.support.ros_master import NO_MASTER, NO_ROSPY, ROSPY_NODE, ros_master
from tests.support.sampling import sample_of

pytest_plugins = ("tests.support.both_ways",)

# How long an example takes says something about the machine, and nothing about the law that it tests.
settings.register_profile("any machine", deadline=None)
settings.load_profile("any machine")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--fail-on-skip", action="store_true", help="end with exit 1 if any test was skipped")
    parser.addoption(
        "--sample",
        type=float,
        metavar="SHARE",
        help="run this part, in (0, 1], of long tests: of the parametrisations of each, or of a folder's tests",
    )
    parser.addoption(
        "--sample-seed", type=int, metavar="N", help="which sample; the header of a run prints it"
    )


def pytest_configure(config: pytest.Config) -> None:
    share = config.option.sample
    if share is None:
        return
    if not 0.0 < share <= 1.0:
        raise pytest.UsageError(f"--sample {share}: no part of all tests (valid: above 0, at most 1)")
    chosen = getattr(config, "workerinput", {}).get("sample_seed", config.option.sample_seed)
    config.option.sample_seed = secrets.randbelow(2**32) if chosen is None else chosen


@pytest.hookimpl(optionalhook=True)
def pytest_configure_node(node: Any) -> None:
    """All processes of pytest-xdist run one sample."""
    node.workerinput["sample_seed"] = node.config.option.sample_seed


def pytest_report_header(config: pytest.Config) -> str | None:
    if config.option.sample is None:
        return None
    return (
        f"of long tests a sample: --sample {config.option.sample} --sample-seed {config.option.sample_seed}"
    )


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if config.option.sample is None:
        return
    long = {item.nodeid for item in items if item.get_closest_marker("long")}
    left_out = long - sample_of(long, config.option.sample, config.option.sample_seed)
    config.hook.pytest_deselected(items=[item for item in items if item.nodeid in left_out])
    items[:] = [item for item in items if item.nodeid not in left_out]


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if not session.config.getoption("--fail-on-skip") or reporter is None:
        return
    skipped = reporter.stats.get("skipped", [])
    if skipped and session.exitstatus == pytest.ExitCode.OK:
        reporter.write_line(f"--fail-on-skip: {len(skipped)} skipped", red=True)
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


@pytest.fixture(scope="session")
def master(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Address of a ROS master of our own, with ROS_MASTER_URI and ROS_IP set for it."""
    if NO_MASTER:
        pytest.skip(NO_MASTER)
    with ros_master(tmp_path_factory.mktemp("ros")) as uri:
        yield uri


@pytest.fixture(scope="session")
def rospy_node(master: str) -> Iterator[Any]:
    """Gives the one rospy node that a process can have; all tests share it."""
    if NO_ROSPY:
        pytest.skip(NO_ROSPY)
    from impedance_modules.backends.baxter.ros.rospy_transport import RospyTransport

    transport = RospyTransport(ROSPY_NODE, master)
    yield transport
    transport.close()
