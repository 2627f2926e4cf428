"""What tests share: where the public data are."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def shared_data() -> Callable[[str], Path]:
    """Give the folder of a public data set by name; skip the test where it is not there."""
    root = Path(os.environ.get("HPOP_DATA", Path(__file__).parents[2] / "shared" / "data"))

    def folder(name: str) -> Path:
        if not (root / name).is_dir():
            pytest.skip(f"no public data {name!r} in {root}; set HPOP_DATA")
        return root / name

    return folder
