"""The grid of bounds of epsilon-constraint: which are asked, skipped, and from where they start."""

import math

import numpy as np

from hpop.criteria import Exposure, Length, Turns
from hpop.planners.programs.epsilon_constraint.grid import Cell, CellCandidate, FreePolyline, Grid, Roles

ROLES = Roles((Exposure(), Turns(), Length()), 2, (0, 2))


def grid(*costs, divisions=0):
    """Return a grid over warm starts of these costs; their geometry does not matter to it."""
    warm = [FreePolyline(None, np.array(row, float)) for row in costs]
    return Grid(ROLES, warm, np.full(3, np.inf), divisions)


def answer(cell, *costs):
    return CellCandidate(cell, FreePolyline(None, np.array(costs, float)), np.array(costs, float), {})


def test_a_wave_has_the_loosest_bound_of_each_count_and_more_of_each_evenly_spaced():
    few = grid(*[(e, n, 10 - e) for n in (2, 3) for e in (1, 2, 3, 4, 5, 6, 7, 8)])
    wave = {tuple(cell.epsilon[:2]) for cell in few.wave(few.levels[0])}
    assert wave == {(e, n) for n in (2, 3) for e in (8, 6, 4, 2)}
    many = grid(*[(e, n, 10 - e) for n in range(20) for e in (1, 2, 3)])
    wave = {tuple(cell.epsilon[:2]) for cell in many.wave(many.levels[0])}
    assert wave == {(3, n) for n in range(20)}
    assert few.wave([]) == []


def test_a_bound_is_answered_only_by_a_looser_one_whose_answer_keeps_it():
    one = grid((3, 2, 5), (2, 2, 6), (1, 2, 7), (2.5, 1, 8))
    loose, middle, tight, few = one.levels[0]
    assert [cell.of for cell in one.levels[0]] == [0, 1, 2, 3]
    one.candidates.append(answer(loose, 1.5, 2, 5))  # keeps middle's bounds too
    assert one.unanswered([loose, middle, tight, few]) == [tight, few]  # an exposure of 1, one turn
    one.candidates.append(answer(tight, 0.5, 1, 7))  # keeps few's bounds, but was asked for more than they do
    assert one.unanswered([loose, middle, tight, few]) == [few]


def test_further_bounds_lie_evenly_down_to_the_next_better_cost_and_end_where_there_is_no_answer():
    one = grid((3, 2, 5), (1, 2, 7), divisions=3)
    cells = [cell for level in one.levels[1:] for cell in level]
    assert [cell.epsilon[0] for cell in cells] == [2.5, 2.0, 1.5]
    assert all(math.isinf(cell.epsilon[2]) and cell.epsilon[1] == 2 for cell in cells)
    one.infeasible.append(cells[1])
    assert one.unanswered(cells) == cells[:1]


def test_a_bound_starts_from_the_nearest_known_trajectory_with_counts_that_keep_it():
    one = grid((3, 2, 5), (1, 4, 4), divisions=1)
    cell = one.levels[1][0]
    assert cell.epsilon.tolist() == [2, 2, math.inf]
    assert one.start(cell) is one.warm[0]  # the other is within the exposure, but turns too often
    one.candidates.append(answer(cell, 1.9, 2, 6))
    assert one.start(cell) is one.candidates[0].solved
    assert one.start(Cell(np.array([2.0, 1.0, np.inf]), 0, 1)) is None
