from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from hpop.frontier import FrontError, ItemFront, UnknownColumnError, is_nondominated
from hpop.frontier.choosing import achievement, differing, knee, lexicographic, nearest, weighted_sum

NAMES = ("turns", "length", "exposure", "d", "e", "f")


def front_of(costs, quantum=1e-6, **changes):
    costs = np.asarray(costs, dtype=float)
    k = costs.shape[1]
    return ItemFront.of(
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


@given(fronts, st.data())
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
def test_a_point_on_the_front_is_nearest_to_itself_and_best_against_itself(Y):
    for row, costs in enumerate(Y):
        assert nearest(Y, costs, Y[:, :0]) == row
        assert achievement(Y, range(Y.shape[1]), costs) == row


@given(fronts, st.permutations(range(6)))
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
        with pytest.raises(UnknownColumnError, match=r"Did you mean 'length'\? Its columns: turns, length"):
            call()
    with pytest.raises(UnknownColumnError, match=r"Did you mean 'length'\?"):
        front.best("le")  # its beginning


def test_a_reported_value_that_a_choice_cannot_take_is_said_to_be_only_reported_and_what_helps():
    front = front_of(
        [[1.0, 2.0], [2.0, 1.0]], reported=[[0.3], [0.1]], reported_names=("obstruction",), reported_units=("1",)
    )
    assert front.nearest({"obstruction": 0.1}).index == 1
    calls = (
        lambda: front.best("obstruction"),
        lambda: front.lexicographic(["turns", "obstruction"]),
        lambda: front.select({"obstruction": 1.0}),
        lambda: front.reference_point({"obstruction": 0.1}),
    )
    helps = r"turns, length, but 'obstruction' is only reported;.*nearest\(\{'obstruction': \.\.\.\}\).*minimises it"
    for call in calls:
        with pytest.raises(UnknownColumnError, match=helps):
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


@given(fronts, st.integers(1, 8))
def test_no_other_choice_of_as_many_rows_leaves_the_others_half_as_far(Y, count):
    """Gonzalez' bound, beside the best choice there is, by trying all of them."""

    def farthest_of(rows):
        return max(min(np.linalg.norm(scaled[i] - scaled[j]) for j in rows) for i in range(len(Y)))

    Y = Y[:7]
    span = np.ptp(Y, axis=0)
    scaled = (Y - Y.min(axis=0)) / np.where(span > 0, span, 1.0)
    rows = differing(Y, count)
    assert len(set(rows)) == len(rows) == min(count, len(Y))
    best = min(farthest_of(others) for others in combinations(range(len(Y)), len(rows)))
    assert farthest_of(rows) <= 2 * best + 1e-9


@given(fronts, st.integers(1, 8), st.data())
def test_rows_that_are_always_chosen_come_first_and_none_is_chosen_twice(Y, count, data):
    always = data.draw(st.lists(st.integers(0, len(Y) - 1), unique=True))
    rows = differing(Y, count, always=always)
    assert rows[: len(always)] == always
    assert len(set(rows)) == len(rows) == max(len(always), min(count, len(Y)))


class Third:
    """Preference for the third row by a person who minds the first cost alone."""

    def row(self, front):
        return 2

    def expected(self, front, costs):
        return costs[:, 0]


def test_select_takes_the_row_that_somebody_prefers():
    front = front_of([[1.0, 5.0], [2.0, 4.0], [3.0, 3.0]])
    assert front.select(preference=Third()).index == 2


def test_select_takes_weights_or_a_preference():
    front = front_of([[1.0, 2.0], [2.0, 1.0]])
    with pytest.raises(FrontError, match="must be a preference, such as"):
        front.select(preference="p07.json")  # type: ignore[arg-type]
    with pytest.raises(FrontError, match="give exactly one"):
        front.select()
    with pytest.raises(FrontError, match="give exactly one"):
        front.select({"turns": 1}, preference=Third())
    with pytest.raises(FrontError, match="with points, but this one has none"):
        front_of(np.empty((0, 2))).select(preference=Third())
