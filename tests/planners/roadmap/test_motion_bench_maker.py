"""All problems of MotionBenchMaker with the Panda are solved, and python-fcl finds every edge of the fronts free."""

from __future__ import annotations

from pathlib import Path

import pytest

import hpop
from hpop.problems.verify import verify
from tests.worlds import NUMBERS, SETS, asked, panda


def problem(data: Path, name: str, number: int) -> hpop.Problem:
    """To grasp, soon, with a calm view of what is grasped."""
    arm, (world, start, goal) = panda(data), asked(data, name, number)
    tool = arm.pose("tool", arm.space.state(goal))
    target = [float(place[0]) for place in (tool.x, tool.y, tool.z)]
    return hpop.Problem(world, arm, start, goal, ["duration", "rotation", {"look_at": {"target": target}}])


def is_solved(asked: hpop.Problem, samples: int) -> None:
    front = asked.solve("roadmap", samples=samples)
    assert len(front)
    assert front.certificate.startswith(f"roadmap: exact on the free part of the roadmap of {samples} samples")
    assert verify(asked, front) == []  # costs, ends, limits of joints; each distinct edge once by python-fcl, at 1 mm


@pytest.mark.cases(1)
@pytest.mark.parametrize("name", SETS)
@pytest.mark.parametrize("number", [NUMBERS[0], pytest.param(NUMBERS[1], marks=pytest.mark.proof)])
def test_there_is_a_path_on_few_samples_and_every_edge_of_the_front_is_free(shared_data, name, number):
    is_solved(problem(shared_data("mbm_panda"), name, number), 200)


@pytest.mark.proof
@pytest.mark.parametrize("name", SETS)
@pytest.mark.parametrize("number", NUMBERS)
def test_there_is_a_path_on_2000_samples_and_every_edge_of_the_front_is_free(shared_data, name, number):
    is_solved(problem(shared_data("mbm_panda"), name, number), 2000)
