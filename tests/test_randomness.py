"""Claims: random numbers are asked for as SPEC 7 says, and what was drawn can be had again by the seed that is told."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import shapely

import hpop
from hpop.base.randomness import seed_of
from hpop.errors import OptionError, ScenarioError
from hpop.planners.graph_planners import Roadmap
from hpop.planners.rrt import RRT
from hpop.scenario import load_scenario

WORLD = hpop.World.from_polygons([shapely.box(4, 0, 5, 3)], extent=shapely.box(0, 0, 9, 6))
PROBLEM = hpop.Problem(WORLD, hpop.DifferentialDrive(), (1, 1, 0), (8, 1, None), ["turns", "length"])


def costs(**options):
    return PROBLEM.solve("roadmap", samples=30, **options).costs.tolist()


def test_a_whole_number_is_the_seed_itself():
    assert costs(rng=3) == costs(rng=np.int64(3)) == costs(seed=3) != costs(seed=4)


def test_a_generator_gives_a_seed_that_is_told_and_goes_on():
    generator = np.random.default_rng(5)
    first, second = Roadmap(samples=30, rng=generator), Roadmap(samples=30, rng=generator)
    assert first.seed != second.seed
    assert first.seed == Roadmap(rng=np.random.default_rng(5)).seed
    front = PROBLEM.solve(first)
    assert f"(seed {first.seed})" in front.certificate
    assert {origin["seed"] for origin in front.provenance} == {first.seed}
    assert front.costs.tolist() == costs(seed=first.seed)


@pytest.mark.parametrize("planner", [Roadmap, RRT])
def test_none_is_fresh_and_nothing_at_all_is_the_seed(planner):
    assert planner(rng=None).seed != planner(rng=None).seed
    assert planner().seed == 0
    assert dataclasses.replace(planner(rng=7)).seed == 7


@pytest.mark.parametrize("source", [np.random.SeedSequence(4), np.random.PCG64(4), np.random.default_rng(4)])
def test_other_sources_of_numpy_are_taken(source):
    assert 0 <= seed_of(source) < 2**63
    assert seed_of(np.random.SeedSequence(4)) == seed_of(np.random.SeedSequence(4))


@pytest.mark.parametrize("rng", [-1, 1.5, True, "4", 2**64, np.random.RandomState(1), [1, 2]])
def test_what_is_no_source_of_random_numbers_is_refused(rng):
    with pytest.raises(OptionError, match=r"rng must be a seed.*Generator, or None"):
        Roadmap(rng=rng)


def test_a_seed_and_a_source_are_not_given_together():
    with pytest.raises(OptionError, match="give either rng or seed"):
        RRT(seed=3, rng=4)


def test_spaces_and_goals_are_sampled_by_a_seed_as_well():
    space = PROBLEM.model.space
    once, again = space.sample(3, 5), space.sample(np.random.default_rng(3), 5)
    assert once.x.tolist() == again.x.tolist()
    assert PROBLEM.target.states(PROBLEM, 3, 2).yaw.tolist() == PROBLEM.target.states(PROBLEM, 3, 2).yaw.tolist()


def test_scenarios_have_a_seed_and_no_source(tmp_path):
    text = """
world: {polygons: {obstacles: [], extent: [[0, 0], [9, 0], [9, 6], [0, 6]]}}
model: {differential_drive: {}}
start: [1, 1, 0]
goal: [8, 1, 0]
criteria: [length]
planner: {roadmap: {samples: 30, NAME: 3}}
"""
    (tmp_path / "good.yaml").write_text(text.replace("NAME", "seed"))
    (tmp_path / "bad.yaml").write_text(text.replace("NAME", "rng"))
    assert load_scenario(tmp_path / "good.yaml").planners[0].seed == 3
    with pytest.raises(ScenarioError, match="rng"):
        load_scenario(tmp_path / "bad.yaml")
