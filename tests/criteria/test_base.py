"""Declaring, making and evaluating criteria: what is refused, and with which words."""

import json
from dataclasses import dataclass

import numpy as np
import pytest
import shapely

from hpop.base.registry import criteria, make_model
from hpop.criteria import Exposure, Turns, criterion, make_criterion, motion_costs, trajectory_cost
from hpop.criteria.base import ROBOT_NEEDS, WORLD_NEEDS, Criterion, describe_criterion
from hpop.criteria.costs import running_costs
from hpop.errors import CriterionError, MapError, UnknownName
from hpop.models import DifferentialDrive
from hpop.motions import Motions, States
from hpop.testing import random_world
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World

WORLD = World.from_polygons([shapely.box(4, 4, 5, 5)], extent=shapely.box(0, 0, 10, 10))
ROBOT = DifferentialDrive()
GOOD = {"group": "C", "unit": "1", "aggregate": "sum"}


@pytest.fixture(autouse=True)
def _the_registry_stays_as_it_was(monkeypatch):
    len(criteria)
    monkeypatch.setattr(criteria, "_types", dict(criteria))


@dataclass(frozen=True)
class Glare:
    """A criterion with a parameter, not declared yet."""

    strength: float = 2.0

    def cost(self, m):
        return self.strength * m.duration


def test_a_declared_criterion_is_found_by_name_and_carries_what_it_declares():
    declared = criterion("glare", group="P", unit="s", aggregate="sum", requires=("camera",), quantum=0.5)(Glare)
    assert criteria["glare"] is declared is Glare
    made = make_criterion({"glare": {"strength": 3.0}})
    assert isinstance(made, Criterion)
    assert (made.name, made.group, made.unit, made.aggregate) == ("glare", "P", "s", "sum")
    assert (made.requires, made.smooth, made.quantum) == (("camera",), True, 0.5)
    assert made == Glare(3.0)


@pytest.mark.parametrize(
    ("name", "changes", "message"),
    [
        ("", {}, "name must be"),
        ("  ", {}, "name must be"),
        ("glare", {"group": "X"}, r"'P' \(performance\), 'C' \(comfort\), 'R' \(robot\), 'O' \(others\), got 'X'"),
        ("glare", {"unit": ""}, "unit must be given; use '1'"),
        ("glare", {"aggregate": "mean"}, "aggregate must be one of .*'time-mean'.*, got 'mean'"),
        (
            "glare",
            {"role": "speed"},
            r"role must be one of \('duration', 'length', 'turns', 'stops_missed'\) or None, got 'speed'",
        ),
        ("glare", {"quantum": 0.0}, "quantum must be a positive number"),
        ("glare", {"quantum": float("nan")}, "quantum must be a positive number"),
        ("glare", {"quantum": float("inf")}, "quantum must be a positive number"),
        ("glare", {"requires": "camera"}, r"requires must be a tuple of names, such as \('camera',\), got 'camera'"),
        ("turns", {}, "criterion name 'turns' is taken by hpop.criteria.comfort.rotation.Turns"),
    ],
)
def test_a_wrong_declaration_is_refused_with_what_is_wrong(name, changes, message):
    with pytest.raises(CriterionError, match=message):
        criterion(name, **{**GOOD, **changes})(Glare)
    assert criteria["turns"] is Turns
    assert "glare" not in criteria


def test_a_class_without_its_decorator_or_cost_is_refused():
    class Plain:
        def cost(self, m):
            return m.duration

    @dataclass(frozen=True)
    class Costless:
        pass

    with pytest.raises(CriterionError, match=r"put @dataclass\(frozen=True\) below @criterion"):
        criterion("glare", **GOOD)(Plain)
    with pytest.raises(CriterionError, match=r"needs a method cost\(self, m\)"):
        criterion("glare", **GOOD)(Costless)
    with pytest.raises(CriterionError, match=r"needs a method .*|dataclass.*; .*"):
        criterion("glare", **GOOD)(type("Nothing", (), {}))


@pytest.mark.parametrize("field", ["name", "group", "unit", "aggregate", "requires", "smooth", "quantum"])
def test_a_parameter_may_not_be_called_like_a_declaration(field):
    cls = type("Odd", (), {"__annotations__": {field: float}, field: 1.0, "cost": lambda self, m: m.duration})
    with pytest.raises(CriterionError, match=f"parameters must not be called {field}, because"):
        criterion("glare", **GOOD)(dataclass(frozen=True)(cls))
    assert "glare" not in criteria


@pytest.mark.parametrize(
    ("spec", "error", "message"),
    [
        ("turn", UnknownName, "Did you mean 'turns'"),
        ({"exposure": {"size": 1}}, CriterionError, "no parameter 'size'. It has radius"),
        ({"turns": {"size": 1}}, CriterionError, "no parameter 'size'. It has none"),
        ({"turns": {}, "length": {}}, CriterionError, "one name with its parameters"),
        ({}, CriterionError, "one name with its parameters"),
        (Turns, CriterionError, r"an instance such as Turns\(\)"),
        (3, CriterionError, "a criterion must be a name or an instance"),
        (lambda m: m.duration, CriterionError, "declare a class of your own with @hpop.criterion"),
    ],
)
def test_what_names_no_criterion_is_refused(spec, error, message):
    with pytest.raises(error, match=message):
        make_criterion(spec)


def test_a_description_survives_json():
    for made in (Exposure(1.5), Turns()):
        assert make_criterion(json.loads(json.dumps(describe_criterion(made)))) == made
    assert make_criterion("turns") == make_criterion({"turns": None}) == Turns()
    assert make_criterion(Turns()) == Turns()


def moves(size=3):
    x = np.arange(float(size))
    start, end = States(x=x, y=x, yaw=0 * x), States(x=x + 1, y=x, yaw=0 * x)
    return Motions(WORLD, ROBOT, ROBOT.laws["move"], start, end)


@pytest.mark.parametrize(
    ("cost", "message"),
    [
        (lambda m: -m.duration, r">= 0, but 3 of 3 'move' motions cost -1.0; shift or clip"),
        (lambda m: np.array([1.0, np.nan, 2.0]), "1 of 3 'move' motions cost nan"),
        (lambda m: np.array([1.0, 2.0, np.inf]), "cost inf"),
        (lambda m: 1.0, r"shape \(3,\), for 'move' motions; it returned shape \(\)"),
        (lambda m: np.zeros((3, 1)), r"it returned shape \(3, 1\)"),
        (lambda m: np.zeros(2), r"it returned shape \(2,\)"),
        (lambda m: np.array(["a", "b", "c"]), "must return numbers"),
        (lambda m: np.array([None, None, None]), "must return numbers"),
        (lambda m: 1j * m.duration, "must return numbers"),
    ],
)
def test_costs_are_checked_and_the_criterion_named(cost, message):
    declared = criterion("glare", **GOOD)(dataclass(frozen=True)(type("Wrong", (), {"cost": lambda self, m: cost(m)})))
    with pytest.raises(CriterionError, match="'glare'.*" + message):
        motion_costs(declared(), moves())


@pytest.mark.parametrize("name", ["passing_distance", "optic_flow", "peak_optic_flow", "obstruction", "turns"])
def test_no_motions_have_no_costs_whatever_a_criterion_makes_of_its_columns(name):
    """A batch is empty where a start needs no joining to a lattice, or a goal no turn."""
    assert motion_costs(make_criterion(name), moves(0)).shape == (0,)


@pytest.mark.parametrize("aggregate", ["sum", "trajectory"])
def test_an_error_in_cost_is_told_with_its_line_and_kept(aggregate):
    failing = type("Failing", (), {"cost": lambda self, m: m.nothing})
    declared = criterion("glare", **{**GOOD, "aggregate": aggregate})(dataclass(frozen=True)(failing))
    trajectory = Trajectory.from_poses(ROBOT, [(1, 1, 0), (2, 1, 0)])
    said = r"'glare' failed \(.*test_base.py, line \d+\): AttributeError: .*nothing"
    with pytest.raises(CriterionError, match=said) as told:
        trajectory_cost(declared(), trajectory, WORLD)
    assert isinstance(told.value.__cause__, AttributeError)


@pytest.mark.parametrize("error", [MemoryError, KeyboardInterrupt, MapError])
def test_what_is_no_mistake_in_cost_passes(error):
    def cost(self, m):
        raise error("as it is")

    declared = criterion("glare", **GOOD)(dataclass(frozen=True)(type("Stopped", (), {"cost": cost})))
    with pytest.raises(error, match="as it is"):
        motion_costs(declared(), moves())


def test_counts_may_be_whole_numbers_or_truth_values():
    for value in (np.array([1, 0, 2]), np.array([True, False, True])):
        cls = type("Count", (), {"cost": lambda self, m, value=value: value})
        declared = criterion("glare", **GOOD)(dataclass(frozen=True)(cls))
        costs = motion_costs(declared(), moves())
        assert costs.dtype == np.float64
        assert costs.tolist() == value.astype(float).tolist()
        del criteria._types["glare"]


def test_a_requirement_that_nobody_meets_is_named():
    declared = criterion("glare", **GOOD, requires=("people", "camera"))(Glare)
    with pytest.raises(CriterionError, match="'glare' requires people, which neither the model nor the world has"):
        motion_costs(declared(), moves())


def test_an_unknown_requirement_lists_the_known_ones_and_proposes_the_nearest():
    declared = criterion("glare", **GOOD, requires=("camra", "landmark"))(Glare)
    with pytest.raises(
        CriterionError, match="requires 'camra', 'landmark', which no robot of hpop and no world prov"
    ) as at:
        motion_costs(declared(), moves())
    for said in ("Did you mean 'camera'? Did you mean 'landmarks'?", "Robots provide some of base, camera, heading, "):
        assert said in str(at.value)
    assert "worlds some of fields, groups, keep_out, landmarks, " in str(at.value)


def test_the_known_requirements_are_those_of_robots_and_worlds():
    """The error on a requirement lists these names; without a provided one, it would call that name unknown."""
    robots = {"differential_drive": {}, "pan_tilt": {"base": "differential_drive"}}
    provided = set().union(*(make_model({name: given}).provides for name, given in robots.items()))
    assert provided <= set(ROBOT_NEEDS)
    content = random_world(np.random.default_rng(0)).contents
    assert content - {"field latency"} <= set(WORLD_NEEDS)  # a field is required by its name


@pytest.mark.parametrize(
    ("aggregate", "value"),
    [("sum", 1 + 2 + 3), ("time-mean", 6 / 6), ("max", 3.0), ("trajectory", 3.0)],
)
def test_motions_add_up_as_declared(aggregate, value):
    declared = criterion("glare", **{**GOOD, "aggregate": aggregate})(Glare)
    line = Trajectory.from_poses(ROBOT, [(0, 0, 0), (1, 0, 0), (3, 0, 0), (6, 0, 0)])
    assert trajectory_cost(declared(strength=1.0), line, WORLD) == pytest.approx(value)


def test_a_criterion_that_accumulates_over_motions_gives_its_last_value():
    cls = type("Sum", (), {"cost": lambda self, m: np.cumsum(m.of_motions(lambda b: b.base.length))})
    declared = criterion("glare", **{**GOOD, "aggregate": "trajectory"})(dataclass(frozen=True)(cls))
    path = Trajectory.from_poses(ROBOT, [(0, 0, 0), (1, 0, 0), (3, 0, 0), (3, 3, 0)])
    assert trajectory_cost(declared(), path, WORLD) == pytest.approx(6.0)
    assert running_costs(declared(), path, WORLD) == pytest.approx([1, 3, 3, 6, 6])
