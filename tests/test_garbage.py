"""Commands collect garbage seldom, and code of others finds Python's exit as it always was."""

from __future__ import annotations

import gc
import subprocess
import sys
from collections.abc import Iterator

import pytest

from hpop.base.registry import criteria, goals, models, planners, readers
from hpop.runtime import interrupts


@pytest.fixture(autouse=True)
def _frozen_as_before() -> Iterator[None]:
    """Objects that the session has frozen stay frozen; what a test froze may be looked through again."""
    before = gc.get_freeze_count()
    gc.unfreeze()
    yield
    gc.unfreeze()
    if before:
        gc.freeze()


def test_what_a_command_leaves_is_not_looked_through(monkeypatch: pytest.MonkeyPatch) -> None:
    for registry in (criteria, goals, models, planners, readers):  # other tests may have registered theirs
        monkeypatch.setattr(registry, "own", dict)
    monkeypatch.delitem(sys.modules, interrupts.COUNTING, raising=False)
    kept = [[] for _ in range(100)]  # type: ignore[var-annotated]
    interrupts.stop_collecting()
    assert gc.get_freeze_count() > len(kept)


def test_where_somebody_elses_code_is_registered_the_end_of_python_is_as_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    def theirs(path: str) -> None:
        """Read a file that may have been left open."""

    theirs.__module__ = "somebody.elses"
    monkeypatch.setattr(readers, "own", lambda: {"theirs": theirs})
    interrupts.stop_collecting()
    assert not gc.get_freeze_count()


def test_where_a_library_prints_what_is_left_the_end_of_python_is_as_ever() -> None:
    """OMPL's bindings name each object that Python has not collected, in some thirty lines on a user's terminal."""
    command = "from hpop.runtime import interrupts; interrupts.collect_rarely(); import ompl.base"
    done = subprocess.run([sys.executable, "-P", "-c", command], capture_output=True, text=True, check=True)
    assert done.stderr == ""
