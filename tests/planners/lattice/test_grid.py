"""The grid: headings, and steps that may or may not cut corners, against geometry."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from hpop.errors import OptionError
from hpop.planners.graphs.lattice.grid import STEPS, Headings, passed_cells, steps_from


@pytest.mark.parametrize("count", [4, 8, 16])
def test_steps_go_round_counter_clockwise_from_ahead_and_each_has_its_opposite(count):
    headings = Headings(count)
    assert headings.yaw[0] == 0.0
    assert len(set(headings.steps)) == count
    assert (np.diff(headings.yaw) > 0).all()
    assert headings.yaw[-1] < 2 * np.pi
    for (dx, dy), yaw in zip(headings.steps, headings.yaw, strict=True):
        assert (dx, dy) == pytest.approx(np.hypot(dx, dy) * np.array([np.cos(yaw), np.sin(yaw)]), abs=1e-12)
    half = count // 2
    assert all((-dx, -dy) == headings.steps[(i + half) % count] for i, (dx, dy) in enumerate(headings.steps))


def test_headings_are_multiples_of_90_and_45_degrees_and_knight_moves_between():
    assert np.degrees(Headings(4).yaw) == pytest.approx(np.arange(4) * 90)
    assert np.degrees(Headings(8).yaw) == pytest.approx(np.arange(8) * 45)
    assert np.degrees(Headings(16).yaw[::2]) == pytest.approx(np.arange(8) * 45)
    assert np.degrees(Headings(16).yaw[1]) == pytest.approx(26.565051177)


@pytest.mark.parametrize("count", [0, 1, 6, 32, None, "8"])
def test_other_counts_of_headings_are_refused(count):
    with pytest.raises(OptionError, match="headings must be one of 4, 8, 16, got"):
        Headings(count)


def square(column, row):
    return shapely.box(column - 0.5, row - 0.5, column + 0.5, row + 0.5)


@pytest.mark.parametrize("step", STEPS[16])
def test_passed_cells_are_those_that_the_line_of_a_step_touches(step):
    line = shapely.LineString([(0, 0), step])
    touched = {
        (c, r)
        for c in range(-3, 4)
        for r in range(-3, 4)
        if (c, r) not in ((0, 0), step) and line.intersects(square(c, r))
    }
    assert set(passed_cells(step)) == touched


@given(hnp.arrays(bool, st.tuples(st.integers(1, 6), st.integers(1, 6))), st.sampled_from(STEPS[16]), st.booleans())
@settings(deadline=None)
def test_steps_join_free_cells_and_pass_only_free_cells(free, step, corner_cutting):
    rows, columns = free.shape
    expected = set()
    for r in range(rows):
        for c in range(columns):
            to_r, to_c = r + step[1], c + step[0]
            if not (free[r, c] and 0 <= to_r < rows and 0 <= to_c < columns and free[to_r, to_c]):
                continue
            line = shapely.LineString([(c, r), (to_c, to_r)])
            blocked = [square(j, i) for i, j in np.argwhere(~free)]
            if corner_cutting or not any(line.intersects(one) for one in blocked):
                expected.add((r, c, to_r, to_c))
    found = list(zip(*(a.tolist() for a in steps_from(free, step, corner_cutting=corner_cutting)), strict=True))
    assert len(found) == len(set(found))
    assert set(found) == expected


def test_a_corner_may_be_cut_only_if_allowed():
    free = np.array([[1, 0], [1, 1]], dtype=bool)  # (column 1, row 0) is blocked
    assert steps_from(free, (1, 1), corner_cutting=False)[0].size == 0
    assert [a.tolist() for a in steps_from(free, (1, 1), corner_cutting=True)] == [[0], [0], [1], [1]]
    assert steps_from(free, (0, 1), corner_cutting=False)[0].tolist() == [0]
