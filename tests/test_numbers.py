"""No number of a scenario ends in a traceback or goes on for ever: each is bounded where a value is made."""

import math
import time
from contextlib import suppress

import numpy as np
import pytest
import shapely

from hpop import DifferentialDrive, Problem, World
from hpop.base.registry import criteria, planners
from hpop.errors import CriterionError, HpopError, OptionError, QueryError
from hpop.planners import Lattice
from hpop.runtime.limits import Budget
from hpop.runtime.sweep import processes
from hpop.scenario import load_scenario
from hpop.search.machinery import ANYTHING, thin_front
from hpop.search.machinery.kernels import least_covered
from hpop.world.content.content import Landmark, Person, Zone
from tests.own_criteria import NEEDED

EXTREME = [1e30, -1e30, 1e308, 1e-320, 5e-324, math.inf, math.nan, 2**63, 10**400, -(10**400), True, "1e-3", [1.0]]
NAMES = [f"{value!r:.12}" for value in EXTREME]
DIGITS = "1" * 390
ROOM = World.from_cells(np.zeros((9, 9), bool), 1.0)
SCENARIO = """
world: {{polygons: {{obstacles: [], extent: [[0, 0], [4, 0], [4, 4], [0, 4]]}}}}
start: {start}
goal: {goal}
criteria: {criteria}
planner: {planner}
"""


def scenario(path, **changes):
    parts = {"start": "[1, 1, 0]", "goal": "[3, 3, any]", "criteria": "[length]", "planner": "lattice", **changes}
    path.write_text(SCENARIO.format(**parts))
    return path


@pytest.mark.parametrize(
    "changes",
    [
        {"start": "[1.0e+30, 1, 0]"},
        {"goal": "[1, -1.0e+308, 0]"},
        {"goal": f"[1, 1, {DIGITS}]"},
        {"start": f"[1, {DIGITS}, 0]"},
        {"goal": f"[1, 1, {DIGITS} deg]"},
        {"planner": "{lattice: {eps: 1.0e+30}}"},
        {"planner": "{lattice: {tolerance: {length: 1.0e+30}}}"},
        {"planner": f"{{lattice: {{step: {DIGITS}}}}}"},
        {"planner": f"{{roadmap: {{samples: {2**63}}}}}"},
        {"planner": f"{{roadmap: {{seed: {10**40}}}}}"},
        {"planner": f"{{lattice: {{max_labels: {10**40}}}}}"},
        {"criteria": "[{curvature_sign_changes: {spacing: 1.0e-320}}]"},
        {"criteria": "[{smoothness: {ramp: 5.0e-324}}]"},
        {"criteria": f"[{{obstruction: {{radius: {DIGITS}}}}}]"},
    ],
)
def test_a_scenario_with_such_a_number_is_refused_with_its_line(tmp_path, changes):
    with pytest.raises(HpopError, match=r"scenario\.yaml, line [3-6], \w+") as caught:
        load_scenario(scenario(tmp_path / "scenario.yaml", **changes))
    assert len(str(caught.value)) < 500


@pytest.mark.parametrize("value", EXTREME, ids=NAMES)
@pytest.mark.parametrize("registry", [criteria, planners], ids=["criteria", "planners"])
def test_no_parameter_of_a_criterion_or_planner_ends_in_a_traceback(registry, value):
    for cls in (cls for cls in registry.values() if cls.__module__.startswith("hpop.")):
        fields = cls.__dataclass_fields__
        given = {key: value for key, value in NEEDED.items() if key in fields}
        for name in (name for name, field in fields.items() if field.init and type(field.default) in (int, float)):
            with suppress(HpopError):
                assert math.isfinite(getattr(cls(**given, **{name: value}), name))


@pytest.mark.parametrize("value", EXTREME, ids=NAMES)
def test_no_number_of_a_world_or_robot_ends_in_a_traceback(value):
    square = shapely.box(0, 0, 1, 1)
    for make in (
        lambda: DifferentialDrive(radius=value),
        lambda: DifferentialDrive(camera_offset=(value, 0)),
        lambda: DifferentialDrive(footprint=((0, 0), (value, 0), (0, 1))),
        lambda: Person(value, 0),
        lambda: Person(0, 0, velocity=(value, 0)),
        lambda: Landmark(0, 0, weight=value),
        lambda: Zone("speed", square, limit=value),
        lambda: Problem(ROOM, DifferentialDrive(), (value, 0, 0), (1, 1, 0), ["length"]),
        lambda: World.from_cells(np.zeros((9, 9), bool), resolution=value),
        lambda: World.from_cells(np.zeros((9, 9), bool), 1.0, origin=(0, value, 0)),
        lambda: World.from_polygons([(square, (0, value))]),
        lambda: Budget(time_limit=value, max_labels=value),
        lambda: processes(value),
    ):
        with suppress(HpopError):
            make()


def test_a_world_beyond_the_earth_is_refused():
    with pytest.raises(HpopError, match=r"within 100,000,000 m of the origin"):
        World.from_polygons([shapely.box(0, 0, 1e9, 1)])


def test_a_world_longer_than_any_country_is_refused():
    with pytest.raises(HpopError, match=r"the world is 1e\+07 x 1 m, expected at most 1,000,000 m across"):
        World.from_polygons([shapely.box(0, 0, 1e7, 1)])


def test_a_cost_of_more_quanta_than_a_double_tells_apart_names_its_criterion():
    world = World.from_polygons([], extent=shapely.box(-5e4, -5e4, 5e4, 5e4))
    asked = Problem(world, DifferentialDrive(), (-25e3, 0, 0), (25e3, 0, None), ["length", "smoothness"])
    with pytest.raises(CriterionError, match=r"costs of smoothness .* quantum 1e-06, got .*e\+1\d"):
        asked.solve("lattice", step=12_500)


def test_coordinates_that_multiply_to_nothing_are_refused():
    with pytest.raises(HpopError, match=r"coordinate of 4.94066e-324 m.*write 0"):
        World.from_polygons([], extent=shapely.Polygon([(0, 0), (5e-324, 0), (3, 2), (0, 2)]))


def test_thousands_of_faults_are_told_by_the_first_in_a_moment(tmp_path):
    text = "world: {polygons: {obstacles: [], extent: [" + "[a], " * 5000 + "]}}\n"
    (tmp_path / "scenario.yaml").write_text(text + "start: [1, 1, 0]\ngoal: [2, 2, 0]\ncriteria: [length]\n")
    began = time.process_time()
    with pytest.raises(HpopError, match=r"and at least [0-9,]+ more faults") as caught:
        load_scenario(tmp_path / "scenario.yaml")
    assert len(str(caught.value).splitlines()) == 21
    assert time.process_time() - began < 5


def test_as_many_processes_as_no_machine_has_are_refused():
    with pytest.raises(OptionError, match="workers must be a whole number of processes from 1 to 1,024"):
        processes(10**20)


def test_numbers_of_numpy_are_as_good_as_those_of_python():
    lattice = Lattice(step=np.float32(0.5), eps=np.float64(0.1), max_turns=np.int64(3), headings=np.int64(8))
    assert lattice == Lattice(step=0.5, eps=0.1, max_turns=3)
    assert type(lattice.max_turns) is int


def test_an_array_as_an_end_is_refused_with_what_is_expected():
    with pytest.raises(QueryError, match="x of the start must be a position in m"):
        Problem(ROOM, DifferentialDrive(), (np.zeros(3), 0, 0), (1, 1, 0), ["length"])


@pytest.mark.parametrize("eps", [0.0, 1e-300, 0.1, 1e6])
@pytest.mark.parametrize("cost", [1, 10**6, 2**52 + 1, ANYTHING])
@pytest.mark.parametrize("tolerance", [0, 7, ANYTHING])
def test_the_least_that_a_cost_covers_is_found_up_to_the_largest_numbers(cost, eps, tolerance):
    kernel = getattr(least_covered, "py_func", least_covered)
    least = kernel(np.int64(cost), eps, np.int64(tolerance))
    assert least + int(least * eps) + tolerance >= cost
    assert least == 0 or (least - 1) + int((least - 1) * eps) + tolerance < cost


def test_thinning_does_not_overflow():
    costs = np.array([[1, ANYTHING], [ANYTHING, 1]], np.int64)
    none = np.zeros((0, 2), np.int64)
    assert thin_front(costs, none, 1e6, np.array([ANYTHING, ANYTHING])).tolist() == [1]
    assert thin_front(costs, none, 0.0, np.zeros(2, np.int64)).tolist() == [0, 1]
