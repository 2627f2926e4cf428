"""Parts of a front: what is selected is what NumPy selects, and the certificate says so."""

from __future__ import annotations

import operator
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hpop.frontier import FrontError, ItemFront, UnknownColumnError, is_nondominated
from tests.frontier.test_choosing import front_of, fronts

COMPARISONS = {
    "<=": operator.le,
    "<": operator.lt,
    ">=": operator.ge,
    ">": operator.gt,
    "==": operator.eq,
    "!=": operator.ne,
}
BOUNDS = st.integers(-2, 14).map(lambda twice: twice / 2)  # halves as well
LINE = np.array([[0.0, 9.0], [1.0, 8.0], [3.0, 4.0], [6.0, 2.0], [9.0, 0.0]])


@pytest.fixture
def line() -> ItemFront:
    """Five points of turns and length, with a reported value each."""
    return front_of(LINE, reported=[[0.5], [0.4], [0.3], [0.2], [0.1 + 0.2]], reported_names=["open space"],
                    reported_units=["1"], provenance=[{"planner": "a", "row": i} for i in range(5)])  # fmt: skip


@given(fronts, st.sampled_from(sorted(COMPARISONS)), BOUNDS, st.booleans())
def test_conditions_select_the_rows_that_numpy_selects(Y, comparison, bound, spaced):
    front = front_of(Y, quantum=1.0)
    found = front.where(turns=f"{comparison}{' ' * spaced}{bound}")
    assert found.costs.tolist() == front.costs[COMPARISONS[comparison](front.costs[:, 0], bound)].tolist()


@given(fronts, BOUNDS, BOUNDS)
def test_several_conditions_hold_together_in_any_order(Y, first, second):
    front = front_of(Y if Y.shape[1] > 1 else np.hstack([Y, -Y]), quantum=1.0)
    both = front.where({"length": f"<={second}"}, turns=f"<={first}")
    assert both.costs.tolist() == front.where(turns=f"<={first}").where(length=f"<={second}").costs.tolist()
    assert is_nondominated(both.costs).all()


@given(fronts, st.data())
def test_slices_and_masks_are_those_of_a_list(Y, data):
    front, ends = front_of(Y), st.none() | st.integers(-25, 25)
    cut = slice(data.draw(ends), data.draw(ends), data.draw(st.none() | st.integers(1, 4)))
    mask = np.array(data.draw(st.lists(st.booleans(), min_size=len(front), max_size=len(front))), dtype=bool)
    assert front[cut].costs.tolist() == front.costs.tolist()[cut]
    assert front[mask].costs.tolist() == front[mask.tolist()].costs.tolist() == front.costs[mask].tolist()
    assert front[mask].items == tuple(item for item, kept in zip(front.items, mask, strict=True) if kept)


def test_a_part_keeps_what_is_known_of_its_points_and_says_of_how_many_it_is(line: ItemFront) -> None:
    part = line[1:3]
    assert part.certificate == "selected from 5 points by rows 1:3: exact"
    assert [(p.index, p.costs, p.reported, p.provenance["row"], p.item) for p in part] == [
        (0, {"turns": 1.0, "length": 8.0}, {"open space": 0.4}, 1, (1.0, 8.0)),
        (1, {"turns": 3.0, "length": 4.0}, {"open space": 0.3}, 2, (3.0, 4.0)),
    ]
    assert (part.names, part.units, part.status) == (line.names, line.units, line.status)
    assert line[:1].certificate.startswith("selected from 5 points by rows :1: ")
    assert line[::2].certificate.startswith("selected from 5 points by rows ::2: ")
    assert line[line.costs[:, 0] < 2].certificate == "selected from 5 points by a mask: exact"
    both = line.where(turns="<=3", length="< 9")
    assert both.certificate == "selected from 5 points by turns <= 3 and length < 9: exact"


def test_each_statement_of_a_joint_certificate_is_of_the_part(line: ItemFront) -> None:
    other = ItemFront.of([[5.0, 3.0]], ["new"], **{
        name: getattr(line, name) for name in ("names", "units", "quanta", "groups", "status")
    }, certificate="local", reported=[[0.9]], reported_names=["open space"], reported_units=["1"])  # fmt: skip
    part = (line | other).where(turns=5)
    assert part.certificate == (
        "selected from 6 points by turns == 5: exact | selected from 6 points by turns == 5: local"
    )
    assert len(part | part) == 1
    assert (part | part).certificate == part.certificate


def test_what_is_reported_can_be_a_condition_and_rounding_does_not_decide(line: ItemFront) -> None:
    assert line.where({"open space": "<=0.3"}).costs.tolist() == LINE[2:].tolist()  # 0.1 + 0.2 is above 0.3
    assert line.where({"open space": 0.3}).costs.tolist() == LINE[[2, 4]].tolist()
    lengths = front_of([[0.1 + 0.2], [0.3]], quantum=1e-6)
    assert (len(lengths.where(turns="<=0.3")), len(lengths.where(turns="<0.3"))) == (1, 0)


def test_where_nothing_is_left_the_certificate_names_the_nearest_point(line: ItemFront) -> None:
    none = line.where(turns="<0", length="<=2")  # 2 of 9 turns are less than 4 of 9 m, and 6 turns too many
    assert len(none) == 0
    assert none.certificate == (
        "selected from 5 points by turns < 0 and length <= 2, which no point meets: the nearest, point 2, has turns 3, "
        "length 4: exact"
    )
    with pytest.raises(FrontError, match=r"with points, but this one has none.*the nearest, point 2, has turns 3"):
        none.knee()
    assert none.where(turns="<=1").certificate.startswith("selected from 0 points by turns <= 1: selected from 5")


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (
            {"turnz": "<=5"},
            "the front has no column 'turnz'. Did you mean 'turns'? Its columns: turns, length, open space",
        ),
        ({"open spaces": "<=5"}, "Did you mean 'open space'?"),
        ({"turns": "=<5"}, "begin with one of <=, >=, <, >, ==, !=, as in '<=5', got '=<' in '=<5'"),
        ({"turns": "5"}, "begin with one of <=, >=, <, >, ==, !=, as in '<=5', got '5'"),
        ({"turns": ""}, "begin with one of"),
        ({"turns": "<="}, "end with a number, as in '<=5', got '<='"),
        ({"turns": "<= five"}, "end with a number"),
        ({"turns": "<=nan"}, "must be a finite number, got '<=nan' for 'turns'"),
        ({"turns": float("nan")}, "must be a finite number, got nan"),
        ({"turns": "<inf"}, "must be a finite number"),
        ({"turns": None}, "must be text such as '<=5', or a number, got None"),
        ({"turns": True}, "or a number, got True"),
        ({"turns": "<=" + "9" * 1000}, "must be text such as"),
        ({}, "at least one condition must be given"),
        ("turns<=5", "conditions must be keywords such as turns='<=5', or a dict"),
    ],
)
def test_what_is_no_condition_is_refused(line: ItemFront, given: object, said: str) -> None:
    with pytest.raises(FrontError, match=re.escape(said)):
        line.where(given)


def test_a_name_with_two_conditions_is_refused(line: ItemFront) -> None:
    with pytest.raises(FrontError, match=r"one condition, got two for \['turns'\]"):
        line.where({"turns": "<=5"}, turns=">=2")
    with pytest.raises(UnknownColumnError):
        line.where(lenght="<=5")


def test_what_is_no_index_is_refused(line: ItemFront) -> None:
    for index in ("turns", None, 1.5, [0, 2], [[True]], [[1], [1, 2]], np.zeros((5, 1), bool)):
        with pytest.raises(TypeError, match="index a front by a row, a slice such as"):
            line[index]
    with pytest.raises(IndexError, match="each of 5 points, got length 2"):
        line[[True, False]]
    with pytest.raises(IndexError, match="keep their order"):
        line[::-1]


def test_a_table_of_pandas_holds_costs_reported_values_and_provenance(line: ItemFront) -> None:
    frame = line.to_dataframe()
    assert frame.columns.tolist() == ["turns", "length", "open space", "provenance.planner", "provenance.row"]
    assert frame[["turns", "length"]].to_numpy().tolist() == line.costs.tolist()
    assert frame["open space"].tolist() == line.reported[:, 0].tolist()
    assert frame["provenance.row"].tolist() == [point.provenance["row"] for point in line]
    assert frame.attrs["units"] == {"turns": "1", "length": "1", "open space": "1"}
    assert frame.attrs["certificate"] == "exact"
    kept = frame[(frame["turns"] <= 6) & (frame["length"] < 9)]  # the same choice by pandas
    assert line.where(turns="<=6", length="<9").to_dataframe()["turns"].tolist() == kept["turns"].tolist()
    assert len(line.where(turns=77).to_dataframe()) == 0


def test_a_dataset_of_xarray_has_units(line: ItemFront) -> None:
    data = line.to_xarray()
    assert data.sizes == {"point": 5}
    assert data["length"].values.tolist() == line.costs[:, 1].tolist()
    assert data["length"].attrs == {"units": "1"}
    assert data.attrs["status"] == "complete"


def test_a_library_that_is_not_there_is_named_with_its_extra(line: ItemFront, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pandas", None)
    with pytest.raises(ImportError, match=r"pip install 'hpop\[tables\]'"):
        line.to_dataframe()
