"""Real buildings for benchmarks: the scenarios of the examples, with exposure, turns and length as their costs."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import hpop
from hpop.scenario import load_scenario

ROOT = Path(__file__).resolve().parents[1]
DATA = Path(os.environ.get("HPOP_DATA", ROOT.parent / "shared" / "data"))
FOLDERS = {
    "aws_bookstore": "aws_bookstore",
    "pal_office": "pal_office",
    "nav2_depot": "nav2_depot",
    "field_museum": "field_museum_main",
}


def missing(name: str) -> str | None:
    """Why a map cannot be read, or None."""
    folder = DATA / FOLDERS[name]
    return None if folder.is_dir() else f"no folder {folder}; set HPOP_DATA to where the public maps are"


def problem(name: str) -> hpop.Problem:
    """Read the world, the robot and the query of an example."""
    text = (ROOT / "examples" / f"{name}.yaml").read_text().replace("../../shared/data", str(DATA))
    with tempfile.TemporaryDirectory() as folder:
        scenario = Path(folder) / "scenario.yaml"
        scenario.write_text(text)
        read = load_scenario(scenario).problem
    return hpop.Problem(read.world, read.model, read.start, read.goal, ["exposure", "turns", "length"])
