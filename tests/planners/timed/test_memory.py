"""Claim: among people who move a plan takes no more than one and a half times its max_memory.

Memory is that of a process of its own, less what it has when kernels and libraries are loaded.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

MOST = 100_000_000  # bytes

PLAN = """
import json, sys
from pathlib import Path
import hpop, hpop.examples
from hpop.planners import Lattice
from hpop.world import Person

def memory(name):
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) * 1024 for line in lines if line.startswith(name))

museum = hpop.examples.museum()
people = [
    Person(26.0, 10.0, velocity=(-1.0, 0.0), until=20.0),
    Person(3.0, 16.0, velocity=(0.9, 0.0), until=22.0),
    Person(24.9, 3.0, velocity=(0.0, 0.8), until=12.0),
    Person(4.7, 14.0, velocity=(0.0, -0.7), until=15.0),
]
problem = hpop.Problem(
    museum.world.with_content(people=people), hpop.DifferentialDrive(radius=0.3), museum.start, museum.goal,
    ["turns", "length", "hall_zones"],
)
options = {"hold": 1.0, "arrive_by": 60.0, "margin": 0.1}
problem.solve(Lattice(step=1.0, clock=0.5, **options))
before = memory("VmRSS")
Path("/proc/self/clear_refs").write_text("5")
front = problem.solve(Lattice(step=0.25, clock=float(sys.argv[1]), max_memory=int(sys.argv[2]), **options))
print(json.dumps({"status": front.status, "points": len(front), "grown": memory("VmHWM") - before}))
"""


@pytest.mark.proof
@pytest.mark.skipif(not Path("/proc/self/clear_refs").exists(), reason="the system does not tell peaks")
@pytest.mark.parametrize("clock", [0.25, 0.125])
def test_among_people_who_move(clock: float) -> None:
    told = subprocess.run(
        [sys.executable, "-c", PLAN, str(clock), str(MOST)], capture_output=True, text=True, check=True, timeout=600
    )
    found = json.loads(told.stdout.splitlines()[-1])
    assert found["status"] == "memory limit"
    assert found["points"] > 0
    assert found["grown"] < 1.5 * MOST
