from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from hpop.frontier import FrontError, ItemFront, is_nondominated


def front_of(costs, *, items=None, **changes):
    costs = np.asarray(costs, dtype=float)
    k = costs.shape[1]
    fields = {
        "names": tuple("abcdef"[:k]),
        "units": ("1",) * k,
        "quanta": np.full(k, 0.1),
        "status": "complete",
        "certificate": "exact",
        **changes,
    }
    return ItemFront.of(costs, list(range(len(costs))) if items is None else items, **fields)


# Tenths plus rounding-sized noise: many candidates are equal in quanta and unequal in float64.
def candidates(k, rows=12):
    tenths = hnp.arrays(np.int64, st.tuples(st.integers(0, rows), st.just(k)), elements=st.integers(0, 4))
    return tenths.flatmap(
        lambda Z: hnp.arrays(np.int64, Z.shape, elements=st.integers(-2, 2)).map(lambda e: Z * 0.1 + e * 1e-12)
    )


three = st.integers(1, 4).flatmap(lambda k: st.tuples(*[candidates(k)] * 3))


def same_costs(a, b):
    return a.costs.tolist() == b.costs.tolist() and (a.status, a.certificate) == (b.status, b.certificate)


@given(three)
def test_union_is_commutative_associative_and_idempotent(triple):
    a, b, c = (
        front_of(costs, status=status, certificate=certificate)
        for costs, status, certificate in zip(
            triple, ("complete", "time limit", "complete"), ("exact", "local", "hit"), strict=True
        )
    )
    assert same_costs(a | b, b | a)
    assert same_costs((a | b) | c, a | (b | c))
    assert same_costs(a | a, a)
    assert same_costs((a | b) | b, a | b)


@given(three)
def test_union_of_fronts_is_the_front_of_all_candidates(triple):
    a, b, c = map(front_of, triple)
    assert (a | b | c).costs.tolist() == front_of(np.vstack(triple)).costs.tolist()


@given(candidates(3), st.randoms(use_true_random=False))
def test_the_order_of_the_candidates_does_not_matter(costs, random):
    order = list(range(len(costs)))
    random.shuffle(order)
    marks = [{"planner": "pq"[i % 2]} for i in range(len(costs))]
    one = front_of(costs, provenance=marks)
    other = front_of(costs[order], provenance=[marks[i] for i in order])
    assert one.costs.tolist() == other.costs.tolist()
    assert one.provenance == other.provenance


@given(candidates(3))
def test_every_candidate_is_covered_within_half_a_quantum(costs):
    front = front_of(costs)
    for row in costs:
        assert (front.costs <= row + 0.05 + 1e-9).all(axis=1).any()
    assert len(np.unique(front.integers, axis=0)) == len(front) == is_nondominated(front.integers).sum()


@given(candidates(2))
def test_each_point_keeps_the_item_that_has_its_costs(costs):
    for point in front_of(costs):
        assert costs[point.item].tolist() == list(point.costs.values())


def test_float_ties_are_one_point_and_the_least_float_vector_is_kept():
    front = front_of([[0.1 + 0.2, 1.0], [0.3, 1.0]], items=["sum", "literal"])
    assert (len(front), front[0].item, front[0].costs) == (1, "literal", {"a": 0.3, "b": 1.0})


def test_without_the_quantum_a_float_tie_would_hide_a_trade_off():
    # 0.3 + 4e-17 against 0.3: equal, so the second cost decides.
    assert [p.item for p in front_of([[0.3, 2.0], [0.1 + 0.2, 1.0]], items=["x", "y"])] == ["y"]


def test_equal_costs_are_settled_by_reported_values_then_provenance():
    fields = {"reported_names": ["t"], "reported_units": ["s"]}
    rows = [(5.0, {"planner": "a"}, 0), (4.0, {"planner": "b"}, 1), (4.0, {"planner": "a"}, 2)]
    for order in itertools.permutations(rows):
        reported, marks, items = zip(*order, strict=True)
        front = front_of([[1.0]] * 3, items=items, reported=np.c_[list(reported)], provenance=marks, **fields)
        assert front[0].item == 2


def test_rows_are_in_lexicographic_order():
    front = front_of([[3.0, 1.0, 0.0], [1.0, 3.0, 0.0], [1.0, 2.0, 5.0], [2.0, 2.0, 1.0]])
    assert front.costs.tolist() == [[1, 2, 5], [1, 3, 0], [2, 2, 1], [3, 1, 0]]


def test_points_carry_all_that_is_known():
    front = front_of(
        [[2.0, 1.0], [1.0, 2.0]],
        items=["x", "y"],
        reported=[[7.0], [8.0]],
        reported_names=["t"],
        reported_units=["s"],
        provenance=[{"w": (1, 2)}, {}],
    )
    assert len(front) == 2
    assert [point.index for point in front] == [0, 1]
    last = front[-1]
    assert (last.index, last.costs, last.reported, last.item) == (1, {"a": 2.0, "b": 1.0}, {"t": 7.0}, "x")
    assert last.provenance == {"w": [1, 2]}
    assert front[np.int64(1)].item == "x"
    for index in (2, -3):
        with pytest.raises(IndexError, match="2 points"):
            front[index]


def test_arrays_cannot_be_changed_from_outside():
    source = np.array([[1.0, 2.0]])
    front = front_of(source)
    source[0, 0] = 9.0
    assert front.costs[0, 0] == 1.0
    for array in (front.costs, front.quanta, front.reported, front.integers):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0


def test_a_front_without_points_is_legal():
    nothing = ItemFront.of([], [], names=["a"], units=["m"], quanta=[1.0], status="no path", certificate="exact")
    assert (len(nothing), nothing.costs.shape, list(nothing)) == (0, (0, 1), [])
    for choose in (nothing.ideal, nothing.nadir, nothing.knee, lambda: nothing.best("a")):
        with pytest.raises(FrontError, match=r"has none.*'no path'"):
            choose()
    something = ItemFront.of([[1.0]], ["x"], names=["a"], units=["m"], quanta=[1.0], status="complete", certificate="c")
    assert (something | nothing).items == ("x",)
    assert (something | nothing).status == "complete | no path"


def test_a_union_claims_no_more_than_its_sources():
    exact = front_of([[1.0, 3.0]], certificate="exact on lattice; turns counted")
    local = front_of([[3.0, 1.0]], certificate="local optima")
    limited = front_of([[2.0, 2.0]], certificate="local optima", status="time limit")
    assert (exact | local).status == "complete"
    assert (exact | local).certificate == "exact on lattice; turns counted | local optima"
    assert (exact | local | limited).status == "complete | time limit"
    assert (exact | local | limited).certificate == (exact | local).certificate


@pytest.mark.parametrize(
    "changes",
    [
        {"names": ("a", "c")},
        {"names": ("b", "a")},
        {"units": ("1", "m")},
        {"quanta": (0.1, 0.2)},
        {"groups": ("P", "")},
        {"reported": [[1.0]], "reported_names": ["t"], "reported_units": ["s"]},
    ],
)
def test_fronts_that_cannot_be_compared_are_not_joined(changes):
    with pytest.raises(FrontError, match="must be equal for a union"):
        front_of([[1.0, 2.0]]) | front_of([[2.0, 1.0]], **changes)


def test_fronts_of_different_problems_are_not_joined():
    first = front_of([[1.0, 2.0]], problem={"start": [0, 0], "goal": [1, 1]})
    second = front_of([[2.0, 1.0]], problem={"start": [0, 5], "goal": [1, 1]})
    with pytest.raises(FrontError, match=r"problems of two fronts must be equal.*'start': \[0, 0\].*'start': \[0, 5\]"):
        first | second
    assert (first | front_of([[2.0, 1.0]])).problem == first.problem
    assert (front_of([[2.0, 1.0]]) | first).problem == first.problem


def test_reported_values_are_joined_by_name():
    first = front_of([[1.0, 2.0]], reported=[[3.0, 4.0]], reported_names=["s", "t"], reported_units=["m", "s"])
    second = front_of([[2.0, 1.0]], reported=[[6.0, 5.0]], reported_names=["t", "s"], reported_units=["s", "m"])
    assert [p.reported for p in first | second] == [{"s": 3.0, "t": 4.0}, {"s": 5.0, "t": 6.0}]
    assert [p.reported for p in second | first] == [{"s": 3.0, "t": 4.0}, {"s": 5.0, "t": 6.0}]


def test_equal_costs_are_settled_alike_whatever_the_order_of_the_reported_columns():
    first = front_of([[1.0]], reported=[[1.0, 2.0]], reported_names=["s", "t"], reported_units=["m", "s"])
    second = front_of([[1.0]], reported=[[1.0, 2.0]], reported_names=["t", "s"], reported_units=["s", "m"])
    assert (first | second)[0].reported == (second | first)[0].reported == {"s": 1.0, "t": 2.0}


def test_negative_zero_is_stored_as_zero():
    assert not np.signbit(front_of([[-0.0, 1.0]]).costs).any()


def test_a_front_joins_only_fronts():
    with pytest.raises(TypeError):
        front_of([[1.0]]) | [[1.0]]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"names": ("a", "a")}, "all different"),
        ({"names": ("a",)}, "costs must have shape"),
        ({"units": ("1",)}, "units must have 2"),
        ({"groups": ("P",)}, "groups must have 2"),
        ({"quanta": (0.1,)}, "quanta must have one entry"),
        ({"items": [1, 2]}, "for 2 items"),
        ({"reported_names": ["t"], "reported_units": ["s"]}, r"reported \(1, 1\)"),
        ({"reported": [[1.0]], "reported_names": ["a"], "reported_units": ["s"]}, "all different"),
        ({"reported": [[np.inf]], "reported_names": ["t"], "reported_units": ["s"]}, "must be finite"),
        ({"provenance": []}, "provenance"),
        ({"provenance": [{"x": np.nan}]}, "JSON"),
        ({"provenance": [{"x": object()}]}, "JSON"),
        ({"problem": {"x": {1, 2}}}, "JSON"),
        ({"status": ""}, "how the search ended"),
        ({"status": "hurra"}, r"status must be one of complete, no path, .*got 'hurra'"),
        ({"certificate": ""}, "what is proved"),
    ],
)
def test_what_does_not_fit_together_is_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        front_of([[1.0, 2.0]], **changes)


@pytest.mark.parametrize("rows", [[[1.0, 1.0], [2.0, 2.0]], [[2.0, 1.0], [1.0, 2.0]], [[1.0, 1.0], [1.0, 1.04]]])
def test_the_constructor_takes_only_what_is_a_front(rows):
    good = front_of([[1.0, 2.0], [2.0, 1.0]])
    fields = {name: getattr(good, name) for name in good.__dataclass_fields__ if name != "integers"}
    assert ItemFront(**fields).costs.tolist() == good.costs.tolist()
    with pytest.raises(ValueError, match=r"Front\.of"):
        ItemFront(**{**fields, "costs": np.array(rows)})


@pytest.mark.parametrize("name", ["Y_N_didactic", "Y_N_sppnw01", "Y_N_sppaa05"])
def test_a_published_front_with_solver_noise_keeps_its_size_in_whole_units(shared_data, name):
    # Set partitioning costs are integers; the files hold some as 54388.99999792847.
    lines = (shared_data("voptlib_known_fronts") / "SPA" / f"{name}.txt").read_text().splitlines()
    Y = np.array([line.split() for line in lines[2:] if line.strip()], dtype=float)
    twice = np.vstack([Y[::-1], np.rint(Y)])
    front = front_of(twice, quanta=(1.0, 1.0))
    assert len(front) == int(lines[1])
    assert {tuple(row) for row in front.integers} == {tuple(row) for row in np.rint(Y)}
    assert (np.abs(front.costs - front.integers) < 0.02).all()


def test_reported_values_need_no_units_and_no_names():
    front = ItemFront.of([[1.0, 2.0], [2.0, 1.0]], reported=[[7.0], [8.0]], reported_names=["seen"])
    assert (front.reported_names, front.reported_units) == (("seen",), ("1",))
    assert front.reported[:, 0].tolist() == [7.0, 8.0]
    named = ItemFront.of([[1.0, 2.0], [2.0, 1.0]], reported=[[7.0, 1.0], [8.0, 2.0]])
    assert (named.reported_names, named.reported_units) == (("r1", "r2"), ("1", "1"))
