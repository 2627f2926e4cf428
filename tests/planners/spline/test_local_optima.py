"""Independent search for improvements of splines that the planner calls settled."""

import numpy as np
import pytest

from hpop.planners.base import make_planner
from tests.planners.spline.better import BetterSplines, random_question


def splines_and_gains(seeds, folder):
    """Return for each spline of random questions whether it is settled, and by what share it can be improved."""
    rows = []
    for seed in seeds:
        problem, path, minimise = random_question(seed, folder)
        result = make_planner({"spline": {"warm_start": [path], "minimise": minimise, "pieces": 6}}).solve(problem)
        search = BetterSplines(problem, minimise, list(problem.evaluate(path).values()), path.duration)
        splines = zip(result.trajectories, result.provenance, strict=True)
        rows += [(origin["settled"], search.improvable(spline)) for spline, origin in splines if origin["pieces"]]
        noted = any("its improvement stopped early" in note for note in result.notes)
        assert noted != all(origin.get("settled", True) for origin in result.provenance)
    settled, gains = np.array(rows).T
    return settled.astype(bool), gains


def test_a_question_is_drawn_anew_if_posts_enclose_the_arm(tmp_path):
    problem, path, _ = random_question(11, tmp_path)  # in its first world no motion from the first joints is free
    collision = problem.model.collision(problem.world)
    assert path.states.size >= 2
    assert all(collision.motions_free(m).all() for _, m in path.batches(problem.world))


@pytest.mark.proof
def test_a_settled_spline_cannot_be_improved(tmp_path):
    settled, gains = splines_and_gains([3], tmp_path)
    assert settled.all()
    assert (gains <= 1e-3).all()


def test_the_search_improves_a_spline_whose_knots_were_displaced(tmp_path):
    problem, path, minimise = random_question(3, tmp_path)
    result = make_planner({"spline": {"warm_start": [path], "minimise": minimise, "pieces": 6}}).solve(problem)
    search = BetterSplines(problem, minimise, [np.inf] * len(problem.criteria), np.inf)
    x = search.read(result.trajectories[0])
    displaced = search.kept(x + 0.02 * search.units(x) * np.append(np.resize([1, -1, 0], x.size - 1), 0))
    assert search.free(displaced)
    assert search.improvable(search.spline(displaced), rounds=3) > 1e-2


@pytest.mark.proof
def test_few_of_many_random_splines_can_be_improved_and_those_are_not_called_settled(tmp_path):
    settled, gains = splines_and_gains(range(24), tmp_path)
    assert len(settled) >= 14
    assert settled.sum() >= len(settled) / 3
    assert (gains[settled] > 1e-3).sum() <= 2
    assert gains[settled].max() <= 3e-3
    assert gains.max() <= 0.02
