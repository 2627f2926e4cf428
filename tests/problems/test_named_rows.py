"""Rows are asked for by number and name: each once, in order; what is none says what there is."""

from __future__ import annotations

import pytest

import hpop
from hpop.errors import OptionError, UnknownName
from hpop.problems.front import Front
from hpop.problems.named_rows import named_rows
from hpop.trajectories.trajectory import Trajectory

MODEL = hpop.DifferentialDrive()


def front(costs, names):
    several = [Trajectory.from_poses(MODEL, [(0, 0, 0), (1 + i, 0, 0)]) for i in range(len(costs))]
    return Front.of(costs, several, names=names)


THREE = front([[1.0, 9.0], [2.0, 3.0], [7.0, 1.0]], ["length", "../<b> turns"])


def test_numbers_and_names_are_rows_each_once_in_the_order_asked():
    assert [row.number for row in named_rows(THREE, [2, "0", "2", 2])] == [2, 0]
    by_name = named_rows(THREE, ["least length", "knee", 0])
    assert [row.number for row in by_name] == [0, 1]
    assert [str(row) for row in by_name] == ["least length (row 0)", "knee (row 1)"]
    assert named_rows(THREE, ["length"])[0].point.costs["length"] == 1.0
    assert str(named_rows(THREE, [2])[0]) == "row 2"
    assert named_rows(THREE, []) == ()


def test_files_are_called_by_letters_digits_and_the_number_whatever_a_criterion_is_called():
    assert [row.stem for row in named_rows(THREE, ["knee", "length", "../<b> turns"])] == [
        "knee_1",
        "least_length_0",
        "least_b_turns_2",
    ]
    odd = front([[1.0]], ["\u202e\x1b[2J/ Höhe 高さ" + "x" * 300])
    (row,) = named_rows(odd, ["\u202e\x1b[2J/ Höhe 高さ" + "x" * 300])
    assert row.stem.startswith("least_2J_Höhe_高さxx")
    assert len(row.stem) < 50
    assert "\x1b" not in str(row)


@pytest.mark.parametrize(
    ("asked", "error", "said"),
    [
        ([3], OptionError, "no row 3: the front has rows 0 to 2; `hpop show` lists them"),
        ([-1], OptionError, "no row -1"),
        ([True], OptionError, "no row True"),
        ([1.0], OptionError, "no row 1.0"),
        (["99999999999999999"], OptionError, "no row 99999999999999999"),
        (["kneee"], UnknownName, "no row is called 'kneee'. Did you mean 'knee'"),
        (["1e9\x1b"], UnknownName, r"called '1e9\\x1b'"),
        ("knee", OptionError, r"rows must be a list of numbers and names, such as \['knee', 3\], got 'knee'"),
        (3, OptionError, "got 3"),
    ],
)
def test_what_is_no_row_is_refused_with_what_there_is(asked, error, said):
    with pytest.raises(error, match=said):
        named_rows(THREE, asked)


def test_a_front_of_one_and_of_none():
    with pytest.raises(OptionError, match="the front has row 0 alone"):
        named_rows(front([[1.0]], ["length"]), [1])
    with pytest.raises(OptionError, match="no trajectories; its search ended with 'time limit'"):
        named_rows(Front.of([], [], names=["length"], status="time limit"), ["knee"])
