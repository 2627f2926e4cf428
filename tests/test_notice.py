"""NOTICE names what hpop is installed with, SECURITY.md every command that listens, the lock every pinned version."""

from __future__ import annotations

import re
import tomllib
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
NEEDED = [re.split(r"[<>=]", one)[0] for one in PROJECT["dependencies"]]
EXTRAS = [
    re.split(r"[<>=]", one)[0]
    for key, extra in PROJECT["optional-dependencies"].items()
    if key != "dev"
    for one in extra
]
LARGE = ["jupedsim"]  # not in the lock of development: its Qt and VTK take 700 MB


@pytest.mark.parametrize("name", [*NEEDED, *EXTRAS])
def test_each_dependency_is_named_and_copyleft_with_its_licence(name: str) -> None:
    notice = (ROOT / "NOTICE").read_text()
    assert re.search(rf"\b{name}\b", notice), "name it in NOTICE with its licence"
    try:
        said = distribution(name).metadata
    except PackageNotFoundError:
        assert name in LARGE
        pytest.skip(f"{name} is not installed")
    licence = f"{said.get('License-Expression') or ''} {(said.get('License') or '')[:80]}"
    if "LGPL" in licence or "Lesser General" in licence:
        assert re.search(rf"\b{name}\s+LGPL", notice)


def test_each_command_that_listens_is_in_the_security_policy() -> None:
    policy = (ROOT / "SECURITY.md").read_text()
    for command in (
        "plan --web",
        "prefer --web",
        "ride --cable",
        "ride --serve",
        "study serve",
        "study serve --network",
        "study live",
        "live",
        "live --network",
    ):
        assert f"`hpop {command}`" in policy


@pytest.mark.parametrize(("name", "extra"), [("requirements-lock.txt", []), ("requirements-lock-dev.txt", EXTRAS)])
def test_a_lock_has_a_hash_for_each_version_that_is_pinned_and_no_other_version(name: str, extra: list[str]) -> None:
    pinned = dict(line.split("==") for line in (ROOT / "constraints.txt").read_text().lower().split())
    lock = (ROOT / name).read_text().lower()
    locked = re.findall(
        r"^([a-z0-9._-]+)==(\S+)[^\n]*((?:\n    --hash=sha256:[0-9a-f]{64}[ \\]*)+)", lock, re.MULTILINE
    )
    assert len(locked) == len(re.findall(r"^\S+==", lock, re.MULTILINE))
    plain = {name.replace("_", "-"): version for name, version in pinned.items()}
    for name, version, _ in locked:
        assert plain.get(name.replace("_", "-"), version) == version
    needed = {one.lower() for one in (*NEEDED, *extra, "setuptools")} - {*LARGE}
    assert needed <= {name for name, _, _ in locked}


def test_make_and_integration_install_nothing_without_a_hash_but_hpop_itself() -> None:
    for name in ("Makefile", ".ci/run"):
        for line in re.findall(r"^.*pip install.*$", (ROOT / name).read_text(), re.MULTILINE):
            if not line.startswith("#"):
                assert "--require-hashes" in line or line.endswith("--no-deps --no-build-isolation -e ."), line


def test_the_policy_names_a_way_to_report_that_exists() -> None:
    report = (ROOT / "SECURITY.md").read_text().partition("## Report")[2].partition("##")[0]
    named = re.findall(r"\]\(([^)]+)\)", report)
    assert named
    assert all((ROOT / path).is_file() for path in named)
    assert "Report a vulnerability" not in report  # a page of a host: no address of one is in the project
