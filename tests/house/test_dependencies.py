# SPDX-License-Identifier: BSD-3-Clause
"""What gets installed is fixed: every package with one version and its hashes, within the bounds of pyproject.toml."""

import re
import tomllib

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests.support.paths import CHECKOUT

PROJECT = tomllib.loads((CHECKOUT / "pyproject.toml").read_text())
FOLDER = CHECKOUT / "requirements"
LOCKED = tuple(sorted(path.stem for path in FOLDER.glob("*.txt")))
GROUPS = {
    "run": ("build",),
    "develop": ("build", "test", "lint"),
    "benchmark": ("benchmark",),
    "docs": ("docs",),
    "audit": ("audit",),
    "ros2": ("ros2",),
}
"""File -> dependency groups that it installs; all but ``ALONE`` install what the package itself needs as well."""

ALONE = ("audit", "ros2")
"""Files of environments without the package."""

HASH = re.compile(r"--hash=sha256:[0-9a-f]{64}")


def entries(name: str) -> list[str]:
    """Lines of a file, with those that go on joined."""
    text = (FOLDER / f"{name}.txt").read_text().replace("\\\n", " ")
    return [line for line in text.splitlines() if line.strip() and not line.startswith("#")]


def locked(name: str) -> list[Requirement]:
    return [Requirement(HASH.sub("", line)) for line in entries(name)]


def wanted(name: str) -> list[Requirement]:
    """What pyproject.toml asks for in a file; `make run` draws pictures and reads bags."""
    texts = [] if name in ALONE else list(PROJECT["project"]["dependencies"])
    for extra in () if name in ALONE else ("plots", "bags"):
        texts += PROJECT["project"]["optional-dependencies"][extra]
    for group in GROUPS[name]:
        texts += PROJECT["dependency-groups"][group]
    return [Requirement(text) for text in texts]


def test_every_file_and_every_group_is_known() -> None:
    assert set(LOCKED) == set(GROUPS)
    assert {group for groups in GROUPS.values() for group in groups} == set(PROJECT["dependency-groups"])


@pytest.mark.parametrize("name", LOCKED)
def test_every_package_has_one_version_and_its_hashes(name: str) -> None:
    for line in entries(name):
        found = Requirement(HASH.sub("", line))
        assert [each.operator for each in found.specifier] == ["=="], line[:80]
        assert found.url is None and "*" not in str(found.specifier), line[:80]
        assert HASH.findall(line), f"{found.name} has no hash: make lock"


@pytest.mark.parametrize("name", LOCKED)
def test_locked_versions_keep_to_the_bounds_of_the_project(name: str) -> None:
    versions: dict[str, list[str]] = {}
    for found in locked(name):
        versions.setdefault(canonicalize_name(found.name), []).append(next(iter(found.specifier)).version)
    for need in wanted(name):
        have = versions.get(canonicalize_name(need.name), [])
        assert have, f"requirements/{name}.txt does not install {need.name}: make lock"
        for version in have:
            assert need.specifier.contains(version, prereleases=True), (
                f"{need} is locked as {version}: make lock"
            )


@pytest.mark.parametrize("name", [name for name in LOCKED if name != "run"])
def test_a_package_has_the_same_version_wherever_it_is_locked(name: str) -> None:
    """``make test`` installs over what ``make run`` installed."""

    def versions(file: str) -> dict[str, set[str]]:
        found: dict[str, set[str]] = {}
        for each in locked(file):
            found.setdefault(canonicalize_name(each.name), set()).add(str(each.specifier))
        return found

    first, other = versions("run"), versions(name)
    assert {package for package in first.keys() & other.keys() if first[package] != other[package]} == set()


def test_builds_use_what_is_locked() -> None:
    build = {canonicalize_name(Requirement(text).name) for text in PROJECT["build-system"]["requires"]}
    assert build <= {canonicalize_name(found.name) for found in locked("run")}


def test_the_makefile_installs_from_locked_files_only() -> None:
    lines = [line for line in (CHECKOUT / "Makefile").read_text().splitlines() if "pip install" in line]
    installs = [line for line in lines if "--no-deps" not in line]
    assert installs and all("--require-hashes -r requirements/" in line for line in installs)
