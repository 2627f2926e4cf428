"""One problem, solved again from other starts and with more options."""

from __future__ import annotations

import math

import pytest
import shapely

import hpop
from hpop.errors import OptionError, QueryError
from hpop.trajectories.trajectory import Trajectory
from hpop.world.content.content import Person

HALL = hpop.World.from_polygons([], extent=shapely.box(0, 0, 10, 10))
WALKER, GUARD = Person(8.0, 2.0, math.pi, (-0.5, 0.25)), Person(5.0, 5.0)


def asked(*people: Person, criteria: tuple[str, ...] = ("hall_zones", "length")) -> hpop.Problem:
    world = HALL.with_content(people=people, groups=[range(len(people))] if len(people) > 1 else [])
    return hpop.Problem(
        world, hpop.DifferentialDrive(radius=0.3), (1, 2, 0), (6, 7, None), criteria, quanta={"length": 0.01}
    )


def test_people_who_move_are_where_their_velocity_brings_them_and_all_else_stays():
    now = asked(WALKER, GUARD)
    later = now.at((3, 2, 0.5), 4.0)
    walker = Person(6.0, 3.0, math.pi, (-0.5, 0.25), until=12.0)  # then it leaves the hall
    assert later.world.content.people == (walker, GUARD)
    assert later.world.content.groups == now.world.content.groups
    assert later.start == (3, 2, 0.5)
    assert (later.goal, later.criteria, later.quanta) == (now.goal, now.criteria, now.quanta)


def test_where_nobody_moves_the_world_is_the_same_one_with_all_that_it_knows():
    now = asked(GUARD, criteria=("length",))
    assert now.at((3, 2, 0), 4.0).world is now.world


def test_what_a_trajectory_costs_is_what_its_parts_cost_each_asked_when_it_begins():
    now, (a, b, c) = asked(WALKER), [(1.0, 2.0, 0.0), (5.0, 2.0, math.pi / 2), (5.0, 6.0, math.pi / 2)]
    whole, first, rest = (Trajectory.from_poses(now.model, poses) for poses in ([a, b, c], [a, b], [b, c]))
    later = now.at(b, first.duration)
    parts = [now.evaluate(first), later.evaluate(rest)]
    for name, cost in now.evaluate(whole).items():
        assert cost == pytest.approx(sum(part[name] for part in parts), rel=1e-9)
    assert now.evaluate(rest)["hall_zones"] != pytest.approx(parts[1]["hall_zones"], rel=0.01)


@pytest.mark.parametrize("t", [-1.0, math.nan, "soon"])
def test_a_time_that_is_none_is_refused(t):
    with pytest.raises(QueryError, match="t must be a time in s"):
        asked(WALKER).at((3, 2, 0), t)


@pytest.mark.parametrize(
    ("planners", "options", "said"),
    [
        (["lattice", "roadmap"], {"checkpoint": "a.ckpt"}, "lattice and roadmap"),
        ([{"lattice": {"checkpoint": "a.ckpt"}}, {"lattice": {"checkpoint": "./a.ckpt"}}], {}, "lattice and lattice"),
        (
            [
                {"roadmap": {"checkpoint": "a.ckpt"}},
                {"smoothing": {"warm_start": {"lattice": {"checkpoint": "a.ckpt"}}}},
            ],
            {},
            "roadmap and lattice",
        ),
    ],
)
def test_two_searches_that_would_be_kept_in_one_file_are_refused_before_anything_is_planned(
    planners, options, said, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    begun = []
    with pytest.raises(OptionError, match=f"its own checkpoint file, but {said} both have '(./)?a.ckpt'; change"):
        asked(criteria=("turns", "length")).solve(planners, progress=begun.append, **options)
    assert begun == list(tmp_path.iterdir()) == []


def test_each_of_two_searches_goes_on_from_its_own_file(tmp_path):
    problem = asked(criteria=("turns", "length"))
    steps = {"a": 0.5, "b": 0.4}

    def planned(**limits):
        each = [{"lattice": {"step": step, "checkpoint": tmp_path / name, **limits}} for name, step in steps.items()]
        return problem.solve(each)

    assert "label limit" in planned(max_labels=40).status
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b"]
    resumed = planned()
    whole = problem.solve([{"lattice": {"step": step}} for step in steps.values()])
    assert resumed.costs.tolist() == whole.costs.tolist()
