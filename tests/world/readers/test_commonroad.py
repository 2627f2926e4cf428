"""Roads in CommonRoad XML: lanes, limits, obstacles and traffic are those of the file; faults have a way out."""

import math
from itertools import product

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

import hpop
from hpop.errors import HpopError, MapError
from hpop.scenario import load_scenario
from hpop.world import World, planning_problem
from hpop.world.content.predictions import bounded
from hpop.world.description import build

CAR = "<rectangle><length>4.5</length><width>1.8</width></rectangle>"


def points(*places):
    return "".join(f"<point><x>{x}</x><y>{y}</y></point>" for x, y in places)


def lanelet(number, left, right, more=""):
    bounds = f"<leftBound>{points(*left)}</leftBound><rightBound>{points(*right)}</rightBound>"
    return f'<lanelet id="{number}">{bounds}{more}</lanelet>'


def straight(number, low, high, more="", begin=0, end=40, back=False):
    """Return a lanelet along x between two y; its traffic goes to the left if ``back``."""
    sides = [(begin, high), (end, high)], [(begin, low), (end, low)]
    return lanelet(number, *((side[::-1] for side in sides[::-1]) if back else sides), more)


def state(x, y, yaw, step, tag="state"):
    turned = "" if yaw is None else f"<orientation><exact>{yaw}</exact></orientation>"
    return f"<{tag}><position>{points((x, y))}</position>{turned}<time><exact>{step}</exact></time></{tag}>"


def moving(number, shape, *states):
    begin, *others = states
    way = "".join(state(*one) for one in others)
    return (
        f'<dynamicObstacle id="{number}"><type>car</type><shape>{shape}</shape>{state(*begin, tag="initialState")}'
        f"<trajectory>{way}</trajectory></dynamicObstacle>"
    )


def standing(number, shape, *begin):
    return (
        f'<staticObstacle id="{number}"><type>parkedVehicle</type><shape>{shape}</shape>'
        f"{state(*begin, tag='initialState')}</staticObstacle>"
    )


def problem(number, begin, *goals):
    asked = "".join(f"<goalState>{goal}</goalState>" for goal in goals)
    return f'<planningProblem id="{number}">{state(*begin, tag="initialState")}{asked}</planningProblem>'


def sign(number, kind, value):
    said = f"<trafficSignID>{kind}</trafficSignID><additionalValue>{value}</additionalValue>"
    return f'<trafficSign id="{number}"><trafficSignElement>{said}</trafficSignElement></trafficSign>'


def road(folder, *elements, version="2020a", step="0.1", name="road.xml"):
    path = folder / name
    path.write_text(
        f'<?xml version="1.0"?>\n<commonRoad commonRoadVersion="{version}" timeStepSize="{step}">'
        f"{''.join(elements)}</commonRoad>"
    )
    return path


LIMIT = '<trafficSignRef ref="9"/>'
TWO_LANES = (straight(1, 0, 4), straight(2, 4, 8, LIMIT, back=True), sign(9, 274, 8.5))
IN_THE_MIDDLE = (
    "<position><rectangle><length>4</length><width>9</width><center><x>30</x><y>4</y></center></rectangle></position>"
)


def test_the_robot_stays_on_the_lanes_for_cars(tmp_path):
    walk = straight(3, 8, 10, "<laneletType>sidewalk</laneletType>")
    bicycles = straight(4, -2, 0, "<userOneWay>bicycle</userOneWay>")
    world = World.from_file(road(tmp_path, *TWO_LANES, walk, bicycles))
    assert world.extent.equals(shapely.box(0, 0, 40, 8))
    assert not world.outside_is_obstacle
    assert any("2 lanes for pedestrians or bicycles" in note for note in world.notes)


@given(st.floats(0, 0.099), st.floats(-1, 1))
@settings(max_examples=20, deadline=None)
def test_gaps_of_up_to_ten_centimetres_between_lanes_are_closed(tmp_path_factory, gap, tilt):
    folder = tmp_path_factory.mktemp("road")
    lanes = (
        lanelet(1, [(0, 4), (20, 4 + tilt)], [(0, 0), (20, tilt)]),
        lanelet(2, [(20 + gap, 4 + tilt), (40, 4)], [(20 + gap, tilt), (40, 0)]),
    )
    world = World.from_file(road(folder, *lanes))
    assert world.extent.geom_type == "Polygon"
    assert not world.extent.interiors
    for area in (
        [(0, 0), (20, tilt), (20, 4 + tilt), (0, 4)],
        [(20 + gap, tilt), (40, 0), (40, 4), (20 + gap, 4 + tilt)],
    ):
        assert shapely.difference(shapely.Polygon(area), world.extent).area < 1e-9
    beyond = [shapely.Polygon([(0, 0), (20, tilt), (40, 0), (40, 4), (20, 4 + tilt), (0, 4)]).buffer(0.2)]
    assert beyond[0].covers(world.extent)


def test_wider_gaps_stay(tmp_path):
    world = World.from_file(road(tmp_path, straight(1, 0, 4, end=20), straight(2, 0, 4, begin=20.5)))
    assert world.extent.geom_type == "MultiPolygon"


def test_speed_limits_are_zones_in_both_versions(tmp_path):
    (zone,) = [zone for zone in World.from_file(road(tmp_path, *TWO_LANES)).content.zones if zone.kind == "speed"]
    assert zone.limit == 8.5
    assert zone.area.equals(shapely.box(0, 4, 40, 8))
    older = road(tmp_path, straight(1, 0, 4, "<speedLimit>13.9</speedLimit>"), version="2018b")
    assert [zone.limit for zone in World.from_file(older).content.zones if zone.kind == "speed"] == [13.9]


def test_a_road_without_limits_says_what_then_limits_the_speed(tmp_path):
    world = World.from_file(road(tmp_path, straight(1, 0, 4)))
    assert not [zone for zone in world.content.zones if zone.kind == "speed"]
    assert any("no lane states a speed limit; the car's own speed holds" in note for note in world.notes)


def test_one_way_zones_point_along_the_traffic_and_leave_out_crossings(tmp_path):
    across = lanelet(3, [(18, -10), (18, 20)], [(22, -10), (22, 20)])
    both = straight(4, 20, 24, "<userBidirectional>car</userBidirectional>")
    world = World.from_file(road(tmp_path, *TWO_LANES, across, both))
    ways = {zone.name: zone for zone in world.content.zones if zone.kind == "one-way"}
    assert set(ways) == {"lane 1", "lane 2", "lane 3"}
    ahead = {name: np.diff(shapely.get_coordinates(zone.path)[[0, -1]], axis=0)[0] for name, zone in ways.items()}
    assert ahead["lane 1"] @ (1, 0) > 0 > ahead["lane 2"] @ (1, 0)
    for one, other in product(ways.values(), repeat=2):
        assert one is other or shapely.intersection(one.area, other.area).area == 0
    assert ways["lane 1"].area.equals(shapely.difference(shapely.box(0, 0, 40, 4), shapely.box(18, 0, 22, 4)))


def test_standing_obstacles_are_where_the_file_puts_them(tmp_path):
    corner = f"<polygon>{points((0, 0), (2, 0), (0, 1))}</polygon>"
    circle = "<circle><radius>0.5</radius><center><x>1</x><y>0</y></center></circle>"
    world = World.from_file(
        road(
            tmp_path,
            *TWO_LANES,
            standing(5, CAR, 10, 2, math.pi / 2, 0),
            standing(6, corner, 20, 2, math.pi, 0),
            standing(7, circle, 30, 2, math.pi / 2, 0),
        ),
        height=(0, 1.5),
    )
    box, wedge, disc = world.obstacles
    assert all(one.heights == (0, 1.5) for one in world.obstacles)
    assert shapely.symmetric_difference(box.polygon, shapely.box(9.1, -0.25, 10.9, 4.25)).area < 1e-9
    turned = shapely.Polygon([(20, 2), (18, 2), (20, 1)])
    assert shapely.symmetric_difference(wedge.polygon, turned).area < 1e-9
    assert disc.polygon.buffer(1e-9).covers(shapely.Point(30, 3).buffer(0.5, quad_segs=64))
    assert disc.polygon.area < 1.02 * math.pi * 0.25


@given(st.floats(0.5, 18), st.floats(0.5, 5), st.floats(-3, 3), st.floats(-math.pi, math.pi), st.floats(0, 30))
@settings(max_examples=30, deadline=None)
def test_discs_cover_a_moving_vehicle_at_every_state(tmp_path_factory, length, width, bend, yaw, speed):
    """The discs are people with recorded tracks; beyond the vehicle they reach at most a third of its width."""
    shape = f"<rectangle><length>{length}</length><width>{width}</width></rectangle>"
    states = [(10 + 0.1 * k * speed, 2 + 0.01 * k * bend, yaw + 0.05 * k * bend, k) for k in range(5)]
    world = World.from_file(
        road(tmp_path_factory.mktemp("road"), *TWO_LANES, moving(5, shape, *states)), reader="commonroad"
    )
    for x, y, turned, k in states:
        body = shapely.affinity.translate(
            shapely.affinity.rotate(
                shapely.box(-length / 2, -width / 2, length / 2, width / 2), turned, origin=(0, 0), use_radians=True
            ),
            x,
            y,
        )
        places = [(*person.at(0.1 * k), person.radius) for person in world.content.people]
        covered = shapely.union_all([shapely.Point(px, py).buffer(r * 1.001, quad_segs=64) for px, py, r in places])
        assert covered.buffer(1e-6).covers(body)
        assert body.buffer(min(length, width) / 3 + 0.01).covers(
            shapely.union_all([shapely.Point(px, py).buffer(r) for px, py, r in places])
        )


def test_uncertain_states_make_a_vehicle_larger(tmp_path):
    centre = "<center><x>{}</x><y>2</y></center>"
    within = f"<position><rectangle><length>0.6</length><width>0.8</width>{centre}</rectangle></position>"
    swung = "<orientation><intervalStart>-0.1</intervalStart><intervalEnd>0.1</intervalEnd></orientation>"
    states = [f"{within.format(10 + k)}{swung}<time><exact>{k}</exact></time>" for k in range(3)]
    car = (
        f'<dynamicObstacle id="5"><type>car</type><shape>{CAR}</shape><initialState>{states[0]}</initialState>'
        f"<trajectory>{''.join(f'<state>{one}</state>' for one in states[1:])}</trajectory></dynamicObstacle>"
    )
    people = World.from_file(road(tmp_path, *TWO_LANES, car)).content.people
    discs = shapely.union_all([shapely.Point(p.at(0.0)).buffer(p.radius, quad_segs=64) for p in people])
    for x, y, yaw in product((9.7, 10.3), (1.6, 2.4), (-0.1, 0.1)):
        body = shapely.affinity.rotate(shapely.box(-2.25, -0.9, 2.25, 0.9), yaw, origin=(0, 0), use_radians=True)
        assert discs.covers(shapely.affinity.translate(body, x, y))


def test_traffic_may_be_faster_than_people_and_can_be_left_out(tmp_path):
    fast = moving(5, CAR, (0, 2, 0, 0), (3, 2, 0, 1), (6, 2, 0, 2))
    path = road(tmp_path, *TWO_LANES, fast)
    people = World.from_file(path).content.people
    assert {person.name for person in people} == {f"car 5, disc {i} of 3" for i in (1, 2, 3)}
    assert all(person.speed == pytest.approx(30) and person.moves for person in people)
    bounded(World.from_file(path), None)
    without = World.from_file(path, traffic=False)
    assert not without.content.people
    assert any("left out" in note for note in without.notes)
    again = build(World.from_file(path).describe())
    assert again.content.people == people


def test_a_vehicle_appears_at_its_first_step_and_drives_ahead_where_no_heading_is_stated(tmp_path):
    late = moving(5, CAR, (10, 2, None, 20), (10, 3, None, 30), (10, 4, None, 40))
    people = World.from_file(road(tmp_path, *TWO_LANES, late)).content.people
    assert {float(person.begin) for person in people} == {2.0}
    assert [float(person.at(3.0)[0]) for person in people] == pytest.approx([10.0] * 3)


def test_a_planning_problem_gives_a_goal_in_each_lane_that_it_crosses(tmp_path):
    found = planning_problem(road(tmp_path, *TWO_LANES, problem(7, (2, 2, 0.1, 0), IN_THE_MIDDLE)))
    assert found.start == (2, 2, 0.1)
    assert sorted(found.goals) == [pytest.approx((30, 2, 0)), pytest.approx((30, 6, math.pi))]
    narrow = "<orientation><intervalStart>0.2</intervalStart><intervalEnd>0.4</intervalEnd></orientation>"
    (one,) = planning_problem(
        road(tmp_path, *TWO_LANES, problem(7, (2, 2, 0, 0), f'<position><lanelet ref="1"/></position>{narrow}'))
    ).goals
    assert one == pytest.approx((20, 2, 0.2))


def scenario(folder, path, **values):
    ends = dict.fromkeys(("start", "goal"), "planning_problem")
    text = {"model": "{ackermann: {speed: 3}}", **ends, "criteria": "[length]", "options": "", **values}
    text |= {"planner": '{exact: {"on": primitives}}'}
    file = folder / "scenario.yaml"
    options = text.pop("options")
    lines = [
        f"world: {{commonroad: {{path: {path.name}{options}}}}}",
        *(f"{key}: {value}" for key, value in text.items()),
    ]
    file.write_text("\n".join(lines))
    return file


def test_a_scenario_plans_from_the_start_to_the_goal_of_a_planning_problem(tmp_path):
    path = road(tmp_path, *TWO_LANES, problem(7, (2, 2, 0, 0), IN_THE_MIDDLE), problem(8, (3, 2, 0, 0), IN_THE_MIDDLE))
    loaded = load_scenario(
        scenario(
            tmp_path,
            path,
            options=", planning_problem: 8",
            zones="[{kind: speed, area: [[0, 0], [9, 0], [9, 4]], limit: 1}]",
        )
    )
    assert [zone.limit for zone in loaded.problem.world.content.zones if zone.kind == "speed"] == [1.0, 8.5]
    front = loaded.problem.solve(loaded.planners[0])
    (path_found,) = front.trajectories
    x, y, yaw = (float(getattr(path_found.states, name)[-1]) for name in ("x", "y", "yaw"))
    assert (x, y) == pytest.approx((30, 2), abs=1e-6)
    assert math.remainder(yaw, math.tau) == pytest.approx(0, abs=1e-6)
    assert float(path_found.states.x[0]) == 3.0


def test_a_robot_that_turns_in_place_waits_for_the_traffic_of_a_road(tmp_path):
    """The oracle is the vehicle's rectangle, not its discs, and the robot as executed."""
    oncoming = moving(5, CAR, (30, 6, math.pi, 0), (0, 6, math.pi, 100))
    path = road(tmp_path, straight(1, 0, 9), oncoming)
    robot = hpop.DifferentialDrive(radius=0.4)

    def gaps(traffic):
        """Return the least distance, m, of the vehicle's rectangle from the robot, for each trajectory of the front."""
        world = World.from_file(path, traffic=traffic)
        query = hpop.Problem(world, robot, (12, 1, math.pi / 2), (12, 8, None), ["duration", "turns"])
        for planned in query.solve({"lattice": {"step": 0.5, "headings": 8}}).trajectories:
            driven, _ = robot.execution(planned)
            times = np.arange(0.0, min(float(driven.times[-1]), 10.0), 0.02)
            x, y = (np.interp(times, driven.times, getattr(driven.states, name)) for name in "xy")
            vehicles = shapely.box(27.75 - 3 * times, 5.1, 32.25 - 3 * times, 6.9)
            yield float(shapely.distance(vehicles, shapely.points(x, y)).min()) - robot.radius

    assert min(gaps(traffic=True)) > 0
    assert min(gaps(traffic=False)) < 0


ENTITY = '<!DOCTYPE commonRoad [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;">]>'
FAULTS = {
    "no XML": ("<commonRoad", "<<", "it must be XML"),
    "entities": ("<commonRoad ", f"{ENTITY}<commonRoad ", "document type or entities"),
    "an old version": ('"2020a"', '"2017a"', "must be 2018b or 2020a, got '2017a'; save it in one of these"),
    "another format": ("commonRoad", "OpenDRIVE", "convert it to CommonRoad"),
    "no lane": ("lanelet", "street", "must have a <lanelet> for cars"),
    "a missing bound": ("leftBound", "middleBound", "two bounds of at least two points"),
    "a coordinate that is no number": ("<x>40</x>", "<x>forty</x>", "got 'forty'"),
    "a coordinate that is not finite": ("<x>40</x>", "<x>inf</x>", "got 'inf'"),
    "a limit in km/h": (">8.5<", ">130<", "in m/s"),
    "a limit of nothing": (">8.5<", "><", "speed limit of traffic sign 9"),
    "no time step": ("timeStepSize", "step", "timeStepSize must be a number"),
    "a step of nothing": ('"0.1"', '"0"', "timeStepSize must be a number"),
    "no shape": ("rectangle", "blob", "needs a <shape>"),
    "a shape of no length": ("<length>4.5", "<length>0", "<length> of dynamicObstacle 5"),
    "a shape of kilometres": ("<length>4.5", "<length>9000", "more than 200"),
    "one time twice": ("<exact>1</exact>", "<exact>0</exact>", "two or more different times"),
    "a time that is not exact": (
        "<time><exact>1</exact>",
        "<time><intervalStart>0</intervalStart><intervalEnd>1</intervalEnd>",
        "must be exact",
    ),
    "too fast": ("<x>13</x>", "<x>33</x>", "faster than any vehicle"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_names_the_file_and_the_element(tmp_path, name):
    old, new, said = FAULTS[name]
    path = road(tmp_path, *TWO_LANES, moving(5, CAR, (10, 2, 0, 0), (13, 2, 0, 1)))
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(MapError) as error:
        World.from_file(path)
    assert said in str(error.value)
    assert "road.xml" in str(error.value)


@given(st.data())
@settings(max_examples=60, deadline=None)
def test_a_broken_file_is_refused_with_an_error_of_hpop(tmp_path_factory, data):
    folder = tmp_path_factory.mktemp("road")
    path = road(
        folder, *TWO_LANES, moving(5, CAR, (10, 2, 0, 0), (13, 2, 0, 1)), problem(7, (2, 2, 0, 0), IN_THE_MIDDLE)
    )
    text = path.read_text()
    begin = data.draw(st.integers(0, len(text) - 1))
    end = min(begin + data.draw(st.integers(0, 30)), len(text))
    put = data.draw(st.sampled_from(["", "0", "-1", "1e300", "nan", "<x>1</x>", "</point>", text[end : end + 40]]))
    path.write_text(text[:begin] + put + text[end:])
    for read in (World.from_file, planning_problem):
        try:
            read(path)
        except HpopError:
            continue


def test_other_formats_say_how_to_convert_them(tmp_path):
    for name, command in (("town.xodr", "odrcr"), ("town.osm", "lanelet2cr")):
        (tmp_path / name).write_text("<x/>")
        with pytest.raises(MapError, match=command):
            World.from_file(tmp_path / name)


@pytest.mark.parametrize(
    ("elements", "said"),
    [
        ((), "has no <planningProblem>"),
        ((problem(7, (2, 2, 0, 0), IN_THE_MIDDLE),) * 2 + (problem(8, (2, 2, 0, 0)),), "several planning problems"),
        (
            (problem(7, (2, 2, 0, 0), "<time><exact>3</exact></time>"),),
            "no goal of planning problem 7 states a position",
        ),
        ((problem(7, (2, 2, None, 0), IN_THE_MIDDLE),), "needs time 0 and an orientation"),
        ((problem(7, (2, 2, 0, 5), IN_THE_MIDDLE),), "needs time 0 and an orientation"),
        ((problem(7, (2, 2, 0, 0), '<position><lanelet ref="77"/></position>'),), "refers to lanelet 77: the file has"),
    ],
)
def test_a_planning_problem_that_cannot_be_used_says_what_to_give(tmp_path, elements, said):
    path = road(tmp_path, *TWO_LANES, *elements)
    with pytest.raises(MapError, match=said):
        planning_problem(path)
    with pytest.raises(HpopError, match=said):
        load_scenario(scenario(tmp_path, path))


def test_a_planning_problem_needs_a_road(tmp_path):
    file = tmp_path / "scenario.yaml"
    file.write_text(
        "world: {polygons: {extent: [[0, 0], [9, 0], [9, 9]]}}\n"
        "start: planning_problem\ngoal: [3, 2, 0]\ncriteria: [length]"
    )
    with pytest.raises(HpopError, match="planning_problem needs a road"):
        load_scenario(file)


def test_a_lane_narrower_than_the_car_is_named(tmp_path):
    """The start is on the lane, and the body beyond it."""
    path = road(tmp_path, straight(1, 0, 0.5), problem(7, (5, 0.25, 0, 0), '<position><lanelet ref="1"/></position>'))
    loaded = load_scenario(scenario(tmp_path, path))
    with pytest.raises(HpopError, match="start"):
        loaded.problem.solve(loaded.planners[0])


def test_hpop_exports_the_reader():
    assert hpop.world.planning_problem is planning_problem


def test_an_obstacle_that_stands_needs_an_orientation_unless_it_is_round(tmp_path):
    for shape, yaw, refused in (
        (CAR, None, True),
        (CAR, 0.3, False),
        ("<circle><radius>1</radius></circle>", None, False),
    ):
        path = road(tmp_path, straight(1, 0, 3), standing(7, shape, 10, 1.5, yaw, 0))
        if refused:
            with pytest.raises(MapError, match="staticObstacle 7 has no <orientation> in its <initialState>; add it"):
                World.from_file(path)
        else:
            assert len(World.from_file(path).obstacles) == 1


@pytest.mark.parametrize(("low", "high", "noted"), [(-1.0, 0.4, True), (0.1, 0.2, False)])
def test_a_goal_beside_all_lanes_says_which_of_its_headings_is_the_goal(tmp_path, low, high, noted):
    heading = f"<orientation><intervalStart>{low}</intervalStart><intervalEnd>{high}</intervalEnd></orientation>"
    circle = f"<position><circle><radius>1</radius><center><x>20</x><y>9</y></center></circle></position>{heading}"
    path = road(tmp_path, straight(1, 0, 3), problem(5, (1, 1.5, 0, 0), circle))
    found = planning_problem(path)
    assert found.goals[0][2] == pytest.approx((low + high) / 2)
    assert any("is on no lane" in note for note in found.notes) is noted
