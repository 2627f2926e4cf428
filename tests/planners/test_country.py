"""Limits hold on a map so large that one edge has a million panels, and its pictures are drawn in bounded memory.

Memory is that of a process of its own, less what the libraries take before there is a problem.
"""

import json
import subprocess
import sys
from pathlib import Path

import pytest

PLAN = """
import json, resource, sys
import shapely, hpop, hpop.view
from hpop.planners.graph_planners import Lattice

def peak():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024

world = hpop.World.from_polygons([shapely.box(45e3, 30e3, 55e3, 45e3)], extent=shapely.box(0, 0, 100e3, 75e3))
problem = hpop.Problem(world, hpop.DifferentialDrive(radius=0.2), (12.5e3, 37.5e3, 0.0), (87.5e3, 37.5e3, 0.0),
    ["exposure", "turns", "length"])
before = peak()
front = problem.solve(Lattice(step=6250.0, time_limit=2.0, max_memory=1_000_000_000))
planned = peak()
few = hpop.Problem(world, problem.model, problem.start, problem.goal, ["turns", "length"])
hpop.view.save_pictures(few, few.solve(Lattice(step=6250.0)), sys.argv[1], dpi=50)
print(json.dumps({"status": front.status, "planned": planned - before, "drawn": peak() - before}))
"""


@pytest.mark.proof
def test_a_map_of_100_km_is_planned_and_drawn_within_its_memory(tmp_path: Path) -> None:
    told = subprocess.run(
        [sys.executable, "-c", PLAN, str(tmp_path)], capture_output=True, text=True, check=True, timeout=900
    )
    found = json.loads(told.stdout.splitlines()[-1])
    assert found["status"] == "time limit"
    assert found["planned"] < 1e9
    assert found["drawn"] < 1e9
