"""Threads of OpenBLAS that have nothing to do sleep soon, unless the user has said how soon."""

from __future__ import annotations

import os

import pytest
from click.testing import CliRunner

from hpop.cli import main
from hpop.cli.commands import SPIN

VARIABLE = "OPENBLAS_THREAD_TIMEOUT"


@pytest.mark.parametrize(("users", "expected"), [(None, SPIN), ("26", "26")])
def test_threads_that_have_nothing_to_do_sleep_soon(
    monkeypatch: pytest.MonkeyPatch, users: str | None, expected: str
) -> None:
    monkeypatch.setenv(VARIABLE, users or "")
    if users is None:
        monkeypatch.delenv(VARIABLE)
    assert CliRunner().invoke(main, ["planners"]).exit_code == 0
    assert os.environ[VARIABLE] == expected
