from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from hpop.frontier import Front, FrontError, UnknownColumnError, is_nondominated
from hpop.frontier.choosing import achievement, knee, lexicographic, nearest, weighted_sum

NAMES = ("turns", "length", "exposure", "d", "e", "f")
quick = settings(deadline=None, max_examples=80)


def front_of(costs, quantum=1e-6, **changes):
    costs = np.asarray(costs, dtype=float)
    k = costs.shape[1]
    return Front.of(
        costs,
        [tuple(row) for row in costs.tolist()],
        names=NAMES[:k],
        units=("1",) * k,
        quanta=np.full(k, quantum),
        status="complete",
        certificate="exact",
        **changes,
    )


fronts = st.tuples(st.integers(1, 20), st.integers(1, 6)).flatmap(
    lambda shape: hnp.arrays(np.float64, shape, elements=st.integers(0, 6).map(float))
)
fronts = fronts.map(lambda Y: Y[is_nondominated(Y)])


def test_ideal_and_nadir_are_the_best_and_worst_of_the_non_dominated():
    front = front_of([[1.0, 5.0], [2.0, 3.0], [4.0, 2.0], [9.0, 9.0]])
    assert front.ideal().tolist() == [1.0, 2.0]
    assert front.nadir().tolist() == [4.0, 5.0]


def test_knee_of_a_cubic_where_its_slope_is_minus_one():
    # y = (1 - x)^3 runs from (0, 1) to (1, 0), deepest below the chord where y' = -1: x = 1 - 1/sqrt(3).
    x = np.linspace(0.0, 1.0, 2001)
    front = front_of(np.column_stack([1000.0 * x, 3.0 + 7.0 * (1 - x) ** 3]), quantum=1e-12)
    point = front.knee()
    assert point.costs["turns"] == pytest.approx(1000 * (1 - 3**-0.5), abs=0.5)
    assert point.costs["length"] == pytest.approx(3 + 7 * 3**-1.5, abs=0.01)


@pytest.mark.parametrize("k", [2, 3, 4, 5, 6])
def test_knee_of_a_symmetric_bulge_is_its_centre(k):
    # sum of sqrt(z_i) = 1: the extreme points are the unit vectors, the deepest point is z_i = 1 / k^2.
    rng = np.random.default_rng(k)
    shares = rng.dirichlet(np.ones(k), 300)
    Y = np.vstack([np.eye(k), np.full(k, 1 / k**2), shares**2])
    assert knee(Y * np.arange(1, k + 1) + 5.0) == k


def test_knee_is_measured_from_the_plane_through_the_extreme_points():
    # (1,0,0), (0,1,0), (.2,.2,1) span x + y + .6 z = 1. Below it (.25,.25,.6) lies 1 - .86 deep and
    # (.3,.6,.05) only 1 - .93, although the second has the lesser plain sum: .95 against 1.1.
    Y = np.array([[1, 0, 0], [0, 1, 0], [0.2, 0.2, 1], [0.3, 0.6, 0.05], [0.25, 0.25, 0.6]])
    assert knee(Y) == 4
    assert knee(Y * [1.0, 60.0, 0.01] - 3.0) == 4


def test_knee_without_a_plane_is_the_least_sum():
    # (1,1,0) and (0,0,1) are two points for three axes: no plane. Sums: 2, 1, 1.2.
    assert knee(np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.4, 0.4, 0.4]])) == 1


def test_a_plane_that_falls_along_a_cost_is_not_used():
    # (1,.8,.8), (0,1,0), (0,0,1) span -.6 x + y + z = 1, which rewards a large x: (.9,.82,.05) is deepest.
    Y = np.array([[1, 0.8, 0.8], [0, 1, 0], [0, 0, 1], [0.9, 0.82, 0.05], [0.05, 0.83, 0.05]])
    assert knee(Y) == 4  # the least plain sum, .93


def test_knee_of_a_straight_front_is_its_middle():
    x = np.arange(11.0)
    assert knee(np.column_stack([x, 10 - x])) == 5


def test_knee_of_a_front_that_bulges_away_is_an_extreme_point():
    angle = np.linspace(0, np.pi / 2, 9)
    assert knee(np.column_stack([np.sin(angle), np.cos(angle)])) in (0, 8)


def test_constant_criteria_do_not_move_the_knee():
    Y = np.array([[0.0, 10.0], [1.0, 4.0], [3.0, 3.0], [9.0, 0.0]])
    assert knee(np.column_stack([np.full(4, 7.3), Y, np.full(4, -2.0)])) == knee(Y) == 1


@given(fronts, st.data())
@quick
def test_choices_do_not_depend_on_units(Y, data):
    k = Y.shape[1]
    scale = np.array(data.draw(st.lists(st.sampled_from([0.25, 1.0, 8.0, 1024.0]), min_size=k, max_size=k)))
    shift = np.array(data.draw(st.lists(st.integers(-50, 50), min_size=k, max_size=k)))
    other, weights, wish = Y * scale + shift, np.arange(1.0, k + 1), np.full(k, 3.0)
    assert knee(other) == knee(Y)
    assert weighted_sum(other, weights) == weighted_sum(Y, weights)
    assert nearest(other, wish * scale + shift, other[:, :0]) == nearest(Y, wish, Y[:, :0])
    assert achievement(other, range(k), wish * scale + shift) == achievement(Y, range(k), wish)


@given(fronts)
@quick
def test_a_point_on_the_front_is_nearest_to_itself_and_best_against_itself(Y):
    for row, costs in enumerate(Y):
        assert nearest(Y, costs, Y[:, :0]) == row
        assert achievement(Y, range(Y.shape[1]), costs) == row


@given(fronts, st.permutations(range(6)))
@quick
def test_lexicographic_is_the_least_tuple(Y, order):
    order = [column for column in order if column < Y.shape[1]]
    assert lexicographic(Y, order) == min(range(len(Y)), key=lambda i: tuple(Y[i, order]))


def test_best_breaks_ties_by_the_other_criteria_in_order():
    front = front_of([[1.0, 4.0, 1.0], [1.0, 3.0, 2.0], [0.0, 9.0, 9.0], [2.0, 3.0, 1.0]])
    assert front.best("turns").item == (0.0, 9.0, 9.0)
    assert front.best("length").item == (1.0, 3.0, 2.0)
    assert front.best("exposure").item == (1.0, 4.0, 1.0)
    assert front.lexicographic(["exposure", "length"]).item == (2.0, 3.0, 1.0)


def test_a_tie_in_quanta_is_a_tie_for_lexicographic_choice():
    front = front_of([[0.1 + 0.2, 1.0, 5.0], [0.3, 2.0, 4.0]])
    assert front.best("turns").costs["length"] == 1.0


def test_nearest_counts_only_what_is_named():
    front = front_of([[0.0, 100.0], [3.0, 50.0], [6.0, 0.0]])
    assert front.nearest({"turns": 2.9}).costs["turns"] == 3.0
    assert front.nearest({"length": 1e6}).costs["length"] == 100.0


def test_nearest_scales_by_the_range():
    # Ranges 10 and 1000: (1, 500) is (.1, .3) away from the wish, (5, 210) is (.5, .01) away.
    front = front_of([[0.0, 1000.0], [1.0, 500.0], [5.0, 210.0], [10.0, 0.0]])
    assert front.nearest({"turns": 0.0, "length": 200.0}).costs["turns"] == 1.0


def test_nearest_breaks_ties_by_the_sum_of_the_rest():
    # turns 2 and 4 are equally far from 3; normalised, the rest sums to 1 + .2 and 0 + 1.
    front = front_of([[2.0, 10.0, 2.0], [4.0, 0.0, 10.0], [9.0, 5.0, 0.0]])
    assert front.nearest({"turns": 3.0}).costs["turns"] == 4.0


def test_nearest_may_name_a_reported_value():
    front = front_of(
        [[1.0, 2.0], [2.0, 1.0]], reported=[[30.0], [10.0]], reported_names=["duration"], reported_units=["s"]
    )
    assert front.nearest({"duration": 12.0}).reported == {"duration": 10.0}
    assert front.nearest({"duration": 29.0, "turns": 1.0}).costs["turns"] == 1.0


def test_a_reported_value_that_varies_by_rounding_alone_decides_nothing():
    front = front_of(
        [[1.0, 9.0], [2.0, 0.0]], reported=[[0.1 + 0.2], [0.3]], reported_names=["rate"], reported_units=["1"]
    )
    assert front.nearest({"turns": 1.0, "rate": 0.3}).costs["turns"] == 1.0


def test_an_aspiration_within_reach_is_improved_on():
    front = front_of([[0.0, 10.0], [4.0, 4.0], [8.0, 3.0], [10.0, 0.0]])
    assert front.nearest({"turns": 8.0, "length": 5.0}).item == (8.0, 3.0)
    assert front.reference_point({"turns": 8.0, "length": 8.0}).item == (4.0, 4.0)


def test_a_reference_point_is_in_the_units_of_the_costs():
    front = front_of([[0.0, 10.0], [4.0, 4.0], [8.0, 3.0], [10.0, 0.0]])
    assert front.reference_point({"turns": 10.0, "length": 0.0}).item == (10.0, 0.0)


def test_points_alike_in_what_is_aspired_to_are_settled_by_the_sum_of_all():
    front = front_of([[1.0, 0.0, 9.0], [1.0, 1.0, 1.0], [2.0, 4.0, 0.0]])
    assert front.reference_point({"turns": 0.0}).item == (1.0, 1.0, 1.0)


def test_reference_points_reach_a_point_that_no_weights_reach():
    front = front_of([[0.0, 10.0], [6.0, 6.0], [10.0, 0.0]])
    assert front.reference_point({"turns": 5.0, "length": 5.0}).item == (6.0, 6.0)
    chosen = {front.select({"turns": w, "length": 1 - w}).item for w in np.linspace(0, 1, 101)}
    assert chosen == {(0.0, 10.0), (10.0, 0.0)}


def test_a_constant_criterion_does_not_blunt_the_reference_point():
    # "turns" misses its aspiration everywhere by far; "length" must still decide.
    front = front_of([[5.0, 1.0, 3.0], [5.0, 2.0, 2.0], [5.0, 3.0, 1.0]])
    assert front.reference_point({"turns": 0.0, "length": 0.5}).costs["length"] == 1.0


def test_weights_act_on_normalised_costs():
    # Normalised: (0, 1), (.3, .4), (1, 0).
    front = front_of([[0.0, 1000.0], [3.0, 400.0], [10.0, 0.0]])
    assert front.select(weights={"turns": 1, "length": 1}).item == (3.0, 400.0)
    assert front.select(weights={"turns": 3, "length": 1}).item == (0.0, 1000.0)
    assert front.select(weights={"length": 1}).item == (10.0, 0.0)


def test_weights_that_tie_are_settled_by_the_plain_sum():
    front = front_of([[1.0, 0.0, 9.0], [1.0, 1.0, 1.0], [2.0, 4.0, 0.0]])
    assert front.select(weights={"turns": 1}).item == (1.0, 1.0, 1.0)  # 1/4 + 1/9 against 9/9


@pytest.mark.parametrize(
    "weights",
    [
        {},
        ["turns"],
        3,
        {"turns": -1.0},
        {"turns": np.nan},
        {"turns": np.inf},
        {"turns": 0.0, "length": 0.0},
        {"turns": "1"},
    ],
)
def test_weights_that_mean_nothing_are_refused(weights):
    with pytest.raises(FrontError, match="weights"):
        front_of([[1.0, 2.0], [2.0, 1.0]]).select(weights)


@pytest.mark.parametrize("wishes", [{}, 3, {"turns": np.nan}, {"turns": np.inf}, {"turns": None}])
def test_wishes_that_mean_nothing_are_refused(wishes):
    front = front_of([[1.0, 2.0], [2.0, 1.0]])
    with pytest.raises(FrontError, match="wishes"):
        front.nearest(wishes)
    with pytest.raises(FrontError, match="aspirations"):
        front.reference_point(wishes)


@pytest.mark.parametrize("order", [[], "turns", ["turns", "turns"]])
def test_an_order_is_a_list_of_distinct_criteria(order):
    with pytest.raises(FrontError, match="distinct"):
        front_of([[1.0, 2.0]]).lexicographic(order)


def test_an_unknown_name_lists_the_known_and_suggests_one():
    front = front_of([[1.0, 2.0]])
    calls = (
        lambda: front.best("lenght"),
        lambda: front.nearest({"lenght": 1.0}),
        lambda: front.select({"lenght": 1.0}),
        lambda: front.reference_point({"lenght": 1.0}),
    )
    for call in calls:
        with pytest.raises(UnknownColumnError, match=r"known: turns, length\. Did you mean 'length'\?"):
            call()


@pytest.mark.parametrize("k", [1, 2, 6])
def test_a_single_point_is_every_choice(k):
    front = front_of([[3.0] * k])
    wish = {"turns": 100.0}
    for point in (front.knee(), front.best("turns"), front.nearest(wish), front.reference_point(wish)):
        assert point.index == 0
    assert front.select({"turns": 1}).index == 0


@pytest.mark.parametrize("name", ["2KP50-11", "2KP50-50", "2KP50-92", "2KP100-50"])
def test_weighted_sums_find_exactly_the_supported_points(shared_data, name):
    """Dichotomic search (Aneja and Nair 1979) by `select` finds as many points as the publishers counted."""
    folder = shared_data("voptlib_known_fronts") / "UKP"
    front = front_of(-np.loadtxt(folder / f"{name}.min", ndmin=2), quantum=1.0)  # profits, maximised
    info = (folder / f"{name}.info").read_text().splitlines()
    line = next(line for line in info if line.startswith("nb supported points"))
    ranges = front.nadir() - front.ideal()

    def between(a, b):
        across = np.array([a[1] - b[1], b[0] - a[0]])  # raw weights for which a and b tie
        weights = dict(zip(front.names, across * ranges, strict=True))
        c = front.select(weights).item
        if across @ c >= across @ a:
            return set()
        return {c} | between(a, c) | between(c, b)

    first, last = front.best("turns").item, front.best("length").item
    assert len({first, last} | between(first, last)) == int(line.split(":")[1])
