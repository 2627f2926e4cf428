"""What tests share: where the public data are, and that Ctrl-C works."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from pathlib import Path

import pytest


def pytest_configure() -> None:
    """Let Ctrl-C interrupt also where a script runs the tests as a job: shells let jobs ignore it."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def shared_data() -> Callable[[str], Path]:
    """Give the folder of a public data set by name; skip the test where it is not there."""
    root = Path(os.environ.get("HPOP_DATA", Path(__file__).parents[2] / "shared" / "data"))

    def folder(name: str) -> Path:
        if not (root / name).is_dir():
            pytest.skip(f"no public data {name!r} in {root}; set HPOP_DATA")
        return root / name

    return folder
