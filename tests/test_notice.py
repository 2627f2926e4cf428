"""NOTICE names what hpop is installed with, SECURITY.md every command that listens, the lock every pinned version."""

from __future__ import annotations

import re
import tomllib
from importlib.metadata import distribution
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


@pytest.mark.parametrize("name", [*NEEDED, *EXTRAS])
def test_each_dependency_is_named_and_copyleft_with_its_licence(name: str) -> None:
    notice = (ROOT / "NOTICE").read_text()
    assert re.search(rf"\b{name}\b", notice), "name it in NOTICE with its licence"
    said = distribution(name).metadata
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
    ):
        assert f"`hpop {command}`" in policy


def test_the_lock_has_a_hash_for_each_version_that_is_pinned_and_no_other_version() -> None:
    pinned = dict(line.split("==") for line in (ROOT / "constraints.txt").read_text().lower().split())
    lock = (ROOT / "requirements-lock.txt").read_text().lower()
    locked = re.findall(
        r"^([a-z0-9._-]+)==(\S+)[^\n]*((?:\n    --hash=sha256:[0-9a-f]{64}[ \\]*)+)", lock, re.MULTILINE
    )
    assert len(locked) > 100
    plain = {name.replace("_", "-"): version for name, version in pinned.items()}
    for name, version, _ in locked:
        assert plain.get(name.replace("_", "-"), version) == version
    needed = {one.lower() for one in (*NEEDED, *EXTRAS)}
    assert needed <= {name for name, _, _ in locked}
