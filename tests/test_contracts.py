"""Contracts of plugins: what a model, criterion, goal, law or collision leaves out has the default of its protocol."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapely

import hpop
from hpop.base.registry import with_optional_members
from hpop.criteria.base import make_criterion
from hpop.errors import QueryError
from hpop.motions import Model, States, collision_of, laws_of
from hpop.trajectories.trajectory import Trajectory

HALL = hpop.World.from_polygons([shapely.box(2.0, 0.0, 2.4, 2.0)], extent=shapely.box(0, 0, 5, 4))


class PlainLaw:
    """A straight move that says no more than a law must."""

    kind = "go"
    varies = frozenset({"x", "y"})

    def __init__(self) -> None:
        self.move = hpop.DifferentialDrive().laws["move"]

    def phases(self, start: States, end: States) -> Any:
        return self.move.phases(start, end)

    def interpolate(self, name: str, start: States, end: States, share: Any) -> Any:
        return self.move.interpolate(name, start, end, share)


def plain_model(**more: Any) -> Any:
    """Return a model of a class that has only the required members, copied from a differential drive."""
    drive = hpop.DifferentialDrive()
    members = {name for name in vars(Model) if not name.startswith("_")}
    methods = {name: staticmethod(getattr(drive, name)) for name in members if callable(getattr(drive, name))}
    values = {name: getattr(drive, name) for name in members - methods.keys()}
    return type("Plain", (), {**values, **methods, "laws": {**drive.laws, "go": PlainLaw()}, **more})()


def test_a_plain_model_has_the_whole_contract_once_a_problem_is_made_of_it() -> None:
    model = plain_model(provides=frozenset({"base", "camera"}))
    hpop.Problem(HALL, model, (1, 1, 0), (4, 1, None), ["length"])
    assert (model.name, model.field_of_view, model.parts, model.platform) == ("Plain", None, (), ())
    assert (model.joints, dict(model.executed), model.notes) == ((), {}, ())
    assert list(model.bodies(States(x=np.zeros(1), y=np.zeros(1), yaw=np.zeros(1)))) == []


def test_a_plain_model_of_prisms_in_the_plane_has_them_as_its_platform() -> None:
    parts = hpop.DifferentialDrive().parts
    model = plain_model(parts=parts)
    Trajectory.from_poses(model, [(1, 1, 0), (1.5, 1, 0)])
    assert model.platform == parts


def test_what_a_plugin_says_stays_whether_its_class_or_its_instance_says_it() -> None:
    class Told:
        notes = ("assumed",)

        def __init__(self) -> None:
            self.field_of_view = (1.0, 0.5)

    told, defaults = Told(), {"notes": (), "field_of_view": None, "joints": ()}
    assert with_optional_members(told, defaults) is told
    assert (told.notes, told.field_of_view, told.joints) == (("assumed",), (1.0, 0.5), ())
    with_optional_members(Told, defaults)
    assert Told().field_of_view == (1.0, 0.5)


def test_a_plain_law_is_neither_reversible_nor_adaptive_and_needs_no_other_states() -> None:
    law = laws_of(plain_model())["go"]
    assert (law.extra, law.reversible, law.quadrature) == ((), False, None)


def test_a_plain_collision_measures_no_clearance_and_has_nothing_to_compile() -> None:
    plain = type("Free", (), {"states_free": None, "motions_free": None, "why_blocked": None})()
    found = collision_of(SimpleNamespace(collision=lambda world: plain), HALL)
    assert (found.clearance, found.least_clearance, found.is_uncompiled) == (None, None, False)


def test_a_plain_criterion_has_the_whole_contract_once_it_is_made() -> None:
    @dataclass(frozen=True)
    class Plain:
        name = "plain"
        group = "R"
        unit = "s"
        aggregate = "sum"
        requires = ()
        smooth = True
        quantum = 1e-3

        def cost(self, m: Any) -> Any:
            return m.duration

    made = make_criterion(Plain())
    assert (made.role, made.world_frame, made.instead, made.integral) == (None, False, (), None)
    assert (made.mean, made.bound, made.convex) == (None, None, None)
    front = hpop.Problem(HALL, hpop.DifferentialDrive(), (1, 3, 0), (4, 3, 0), [Plain()]).solve(
        hpop.planners.Lattice(step=1.0)
    )
    assert front.costs[0, 0] == pytest.approx(3.0)


class Right:
    """Anywhere right of x = 3 m, of a plain class."""

    def states(self, problem: hpop.Problem, rng: Any, count: int) -> States:
        rng = np.random.default_rng(rng)
        return States(x=rng.uniform(3.5, 4.5, count), y=rng.uniform(0.5, 3.5, count), yaw=np.zeros(count))

    def reached(self, model: Model, states: States) -> Any:
        return states.x >= 3.0

    def describe(self) -> Any:
        return {"right": {}}


def test_a_plain_goal_lists_no_states_marks_nothing_and_is_its_own_alternative() -> None:
    goal = Right()
    problem = hpop.Problem(HALL, hpop.DifferentialDrive(), (1, 1, 0), goal, ["length"])
    target = problem.target
    assert (target.requires, target.places, target.listed, target.looked_at) == (frozenset(), (), (), None)
    assert target.alternatives() == (goal,)
    with pytest.raises(QueryError, match="a goal that is a state, or a list of states"):
        problem.solve("lattice")


def test_goals_of_which_any_will_do_are_the_alternatives_of_all() -> None:
    look = hpop.goals.LookAt((4.0, 3.0, 1.0), (0.2, 2.0))
    several = hpop.Problem(HALL, hpop.DifferentialDrive(), (1, 1, 0), [look, (4, 1, None)], ["length"]).target
    assert [one.looked_at for one in several.alternatives()] == [None, (4.0, 3.0, 1.0)]
    assert [one.listed for one in several.alternatives()] == [((4.0, 1.0, None),), ()]
