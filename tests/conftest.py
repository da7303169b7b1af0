# SPDX-License-Identifier: BSD-3-Clause
"""One option for the machine that decides what lands, where a skipped test is a failed run; a ROS master."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from tests.support.ros_master import NO_MASTER, NO_ROSPY, ros_master

pytest_plugins = ("tests.support.both_ways",)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--fail-on-skip", action="store_true", help="end with exit 1 if any test was skipped")


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
    from impedance_modules.backends.baxter.transport.with_rospy import RospyTransport

    transport = RospyTransport("/by_rospy", master)
    yield transport
    transport.close()
