"""Whatever a caller or a file gives in place of a name, a number or an object, the answer is one short message."""

import os
from contextlib import suppress

import numpy as np
import pytest
import shapely
from click.testing import CliRunner

import hpop
from hpop import DifferentialDrive, Problem, World
from hpop.base.registry import criteria
from hpop.cli import main
from hpop.criteria import Length
from hpop.errors import CriterionError, HpopError, UnknownName
from hpop.frontier.points import FrontError, FrontFileError
from hpop.planners import EpsilonConstraint, Lattice, WeightedSumCorridor
from hpop.testing import check_criterion
from hpop.trajectories.trajectory import Trajectory
from hpop.world.content.content import Person, Zone


class Unprintable:
    def __repr__(self):
        raise RuntimeError("no repr")


STRANGE = {
    "none": None,
    "list": [],
    "nested": [["x"]],
    "dict": {"a": [1]},
    "set": {"length"},
    "vector": np.zeros(3),
    "matrix": np.zeros((2, 2)),
    "scalar array": np.array(5.0),
    "400 digits": 10**400,
    "long text": "x" * 10_000,
    "unprintable": Unprintable(),
    "class": World,
    "complex": 1j,
    "bytes": b"x",
}
ROOM = World.from_cells(np.zeros((20, 20), bool), 0.2)
ROBOT = DifferentialDrive(radius=0.2)
SQUARE = shapely.box(0, 0, 1, 1)


@pytest.fixture(scope="module")
def problem():
    return Problem(ROOM, ROBOT, (0.5, 0.5, 0), (3, 3, None), ["length"])


@pytest.fixture(scope="module")
def front(problem):
    return problem.solve("lattice", step=0.5)


@pytest.mark.parametrize("value", STRANGE.values(), ids=STRANGE)
def test_what_is_given_in_place_of_something_else_is_refused_in_a_short_message(problem, front, value):
    described = front.trajectories[0].describe()
    for make in (
        lambda: Problem(value, ROBOT, (0.5, 0.5, 0), (3, 3, None), ["length"]),
        lambda: Problem(ROOM, value, (0.5, 0.5, 0), (3, 3, None), ["length"]),
        lambda: Problem(ROOM, ROBOT, value, (3, 3, None), ["length"]),
        lambda: Problem(ROOM, ROBOT, (0.5, 0.5, 0), (value, 3, None), ["length"]),
        lambda: Problem(ROOM, ROBOT, (0.5, 0.5, 0), (3, 3, None), [value]),
        lambda: Problem(ROOM, ROBOT, (0.5, 0.5, 0), (3, 3, None), [{"obstruction": {"radius": value}}]),
        lambda: Problem.from_description(value),
        lambda: Problem.from_description({**problem.describe(), "world": value}),
        lambda: problem.solve([value]),
        lambda: problem.evaluate(value),
        lambda: criteria[value],
        lambda: Lattice(tolerance=value),
        lambda: EpsilonConstraint(warm_start=value),
        lambda: WeightedSumCorridor(solver=value),
        lambda: Person(0, 0, velocity=value),
        lambda: Zone(value, SQUARE),
        lambda: ROOM.with_content(people=value),
        lambda: World.from_polygons(value),
        lambda: World.from_polygons([SQUARE], extent=value),
        lambda: World.from_geojson(value),
        lambda: front.best(value),
        lambda: front.lexicographic(value),
        lambda: front.nearest(value),
        lambda: front.trajectories[0].at(value),
        lambda: Trajectory.from_description(ROBOT, {**described, "kinds": value}),
        lambda: Trajectory.from_description(ROBOT, {**described, "states": {**described["states"], "x": value}}),
        lambda: hpop.Front.load(value),
        lambda: check_criterion(value),
    ):
        with suppress(FrontFileError, FrontError, OSError), suppress(HpopError):
            make()


@pytest.mark.parametrize("name", ["x" * 10**6, ["length"], np.zeros(3), None], ids=["long", "list", "array", "none"])
def test_an_unknown_name_is_told_in_short_whatever_it_is(name):
    with pytest.raises(UnknownName, match=r"unknown criterion .*`hpop criteria` ") as caught:
        criteria[name]
    assert len(str(caught.value)) < 1500


def test_a_class_in_the_place_of_a_criterion_is_told_how_to_make_one():
    with pytest.raises(CriterionError, match=r"expected an instance of a criterion, such as Length\(\), got <class"):
        check_criterion(Length)


@pytest.mark.parametrize("path", ["n" * 300, "n/" * 3000, "n" * 300 + ".py"], ids=["name", "path", "module"])
@pytest.mark.parametrize(
    "arguments",
    [
        ("show", "{}"),
        ("plan", "{}", "--out", "out"),
        ("plan", "scenario.yaml", "--out", "{}"),
        ("plan", "scenario.yaml", "--out", "out", "--checkpoint", "{}"),
        ("plan", "scenario.yaml", "--out", "out", "--import", "{}"),
        ("check", "{}"),
        ("check", "{}:Mine"),
    ],
)
def test_a_name_that_no_system_has_is_one_message(tmp_path, monkeypatch, arguments, path):
    monkeypatch.chdir(tmp_path)
    scenario = "world: {polygons: {obstacles: [], extent: [[0, 0], [3, 0], [3, 2], [0, 2]]}}\nstart: [0.5, 0.5, 0]\n"
    (tmp_path / "scenario.yaml").write_text(
        scenario + "goal: [2, 0.5, any]\ncriteria: [length]\nplanner: {lattice: {step: 0.5}}\n"
    )
    result = CliRunner().invoke(main, [argument.format(path) for argument in arguments])
    assert isinstance(result.exception, SystemExit)
    assert result.exit_code != 0
    assert result.stderr.startswith("error: ")


@pytest.mark.parametrize("path", ["/dev/zero", "fifo"])
def test_show_reads_regular_files_only(tmp_path, monkeypatch, path):
    monkeypatch.chdir(tmp_path)
    os.mkfifo("fifo")
    result = CliRunner().invoke(main, ["show", path])
    assert result.exit_code == 12
    assert "expected a regular file" in result.stderr
