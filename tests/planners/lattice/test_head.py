"""Lattices of a robot with a pan-tilt head, against an oracle that lists its own states and motions in plain loops."""

from __future__ import annotations

import math
from collections import defaultdict
from itertools import product

import numpy as np
import pytest
import shapely

import hpop
from hpop.criteria.costs import motion_costs
from hpop.errors import OptionError
from hpop.motions import Motions, States
from hpop.planners.graph_planners import Lattice
from hpop.planners.objectives import edge_objectives
from hpop.problems.verify import verify
from hpop.trajectories.trajectory import Trajectory
from hpop.world.content.content import Landmark
from tests.planners.lattice.test_planner import nondominated

STEP, QUARTER = 0.5, 90
SEEN = [(1.7, 1.8, 1.5, 2), (2.4, 0.2, 1.7, 3), (1.8, 0.6, 1.4, 2)]  # x, y, z, weight
WORLD = hpop.World.from_polygons(
    [(shapely.box(1.25, 0.85, 1.5, 1.15), (0.0, 0.3))], extent=shapely.box(0, 0, 3, 2)
).with_content(
    landmarks=[Landmark(1.7, 1.8, 1.5, weight=2), Landmark(2.4, 0.2, 1.7, weight=3), Landmark(1.8, 0.6, 1.4, weight=2)]
)
BASE = hpop.DifferentialDrive(radius=0.2, camera_height=1.2, speed=0.2)  # so that looking about pays
STOPPED = hpop.PanTilt(BASE, pan=(math.radians(-100), math.radians(190)), tilt=(0.0, 0.0), field_of_view=(1.5, 3.0))
TILTING = hpop.PanTilt(BASE, pan=(math.radians(-100), math.radians(10)), tilt=(-0.3, 0.5), field_of_view=(1.5, 0.5))
ALL_ROUND = hpop.PanTilt(BASE, pan="all round", tilt=(0.0, 0.0), field_of_view=(1.5, 3.0))
CRITERIA = ["rotation", {"landmark_blindness": {"near": 2.0, "far": 3.0}}, "duration"]


def shorter(turn: int) -> int:
    """Return an equal turn in (-180, 180], degrees."""
    return 180 - (180 - turn) % 360


def motions_of(model: hpop.PanTilt, start: tuple[float, float]) -> list[tuple[str, tuple[int, ...], tuple[float, ...]]]:
    """Kind, tail (column, row, yaw, pan, tilt) and unwrapped end of every motion; angles in degrees."""
    if model.pan == "all round":
        pans = [-90, 0, 90, 180]
    else:
        low, high = (math.degrees(stop) for stop in model.pan)
        pans = [pan for pan in range(-720, 721, QUARTER) if low <= pan <= high]
    tilts = sorted({model.tilt[0], 0.0, model.tilt[1]})
    free = [
        (i, j)
        for i, j in product(range(-5, 6), repeat=2)
        if WORLD.clearance(np.array([start[0] + i * STEP]), np.array([start[1] + j * STEP]))[0] >= BASE.radius - 1e-9
    ]
    found = []
    for (i, j), yaw, pan, tilt in product(free, range(0, 360, QUARTER), pans, tilts):
        tail = (i, j, yaw, pan, tilt)
        step = (i + round(math.cos(math.radians(yaw))), j + round(math.sin(math.radians(yaw))))
        if step in free:
            found.append(("move", tail, (*step, yaw, pan, tilt)))
        for turn in (-90, 90, 180):
            found.append(("turn", tail, (i, j, yaw + turn, pan, tilt)))
            if model.pan == "all round" or pan - turn in pans:
                found.append(("unwind", tail, (i, j, yaw + turn, pan - turn, tilt)))
        for other in pans:
            turn = shorter(other - pan) if model.pan == "all round" else other - pan
            if turn:
                found.append(("pan", tail, (i, j, yaw, pan + turn, tilt)))
        found += [("tilt", tail, (i, j, yaw, pan, other)) for other in tilts if other != tilt]
    return found


def oracle(problem: hpop.Problem) -> set[tuple[int, ...]]:
    """Non-dominated vectors, in quanta, of all walks from the start to the goal at any tilt."""
    model, objectives = problem.model, edge_objectives(problem.criteria, "oracle").optimised
    by_kind = defaultdict(list)
    for kind, tail, end in motions_of(model, problem.start[:2]):
        by_kind[kind].append((tail, end))

    def states(rows):
        i, j, yaw, pan, tilt = np.array(rows, float).T
        x, y = problem.start[0] + STEP * i, problem.start[1] + STEP * j
        return States(x=x, y=y, yaw=np.radians(yaw), pan=np.radians(pan), tilt=tilt)

    leaving = defaultdict(list)
    for kind, ends in by_kind.items():
        tails, heads = zip(*ends, strict=True)
        motions = Motions(WORLD, model, model.laws[kind], states(tails), states(heads))
        counts = [np.ceil(motion_costs(c, motions) / c.quantum - 1e-6).astype(int).tolist() for c in objectives]
        for tail, (i, j, yaw, pan, tilt), *cost in zip(tails, heads, *counts, strict=True):
            pan = shorter(pan) if model.pan == "all round" else pan
            leaving[tail].append(((i, j, yaw % 360, pan, tilt), tuple(cost)))
    source = (0, 0, round(math.degrees(problem.start[2])) % 360, 0, 0.0)
    sets, changed = {source: {(0,) * len(objectives)}}, {source}
    while changed:
        tail = changed.pop()
        for head, cost in leaving[tail]:
            longer = {tuple(a + c for a, c in zip(v, cost, strict=True)) for v in sets[tail]}
            merged = nondominated(sets.get(head, set()) | longer)
            if merged != sets.get(head):
                sets[head] = merged
                changed.add(head)
    place = tuple(round((problem.goal[k] - problem.start[k]) / STEP) for k in (0, 1))
    yaw, pan = (round(math.degrees(angle)) for angle in problem.goal[2:4])
    return nondominated(set().union(*(v for state, v in sets.items() if state[:4] == (*place, yaw, pan))))


@pytest.mark.cases("tilts")
@pytest.mark.parametrize("model", [STOPPED, TILTING, ALL_ROUND], ids=["stops", "tilts", "all round"])
def test_the_front_is_that_of_all_walks(model: hpop.PanTilt) -> None:
    problem = hpop.Problem(WORLD, model, (0.5, 0.5, -math.pi / 2, 0, 0), (2.5, 1.5, math.pi, 0, None), CRITERIA)
    found = Lattice(step=STEP, headings=4).solve(problem)
    quanta = [criterion.quantum for criterion in found.objectives]
    expected = oracle(problem)
    assert {tuple(row) for row in np.rint(found.planned / quanta).astype(int).tolist()} == expected
    assert len(expected) > 6
    front = problem.front(found)
    assert verify(problem, front) == []
    used = {kind for trajectory in front.trajectories for kind in trajectory.kinds}
    assert used == {"move", "turn", "pan", "unwind", *["tilt"] * (model is TILTING)}
    for trajectory in front.trajectories:
        passed = trajectory.at(np.linspace(0.0, trajectory.duration, 300))
        if model.pan != "all round":
            assert model.pan[0] - 1e-9 <= passed.pan.min() <= passed.pan.max() <= model.pan[1] + 1e-9
        assert model.tilt[0] - 1e-9 <= passed.tilt.min() <= passed.tilt.max() <= model.tilt[1] + 1e-9


def test_pans_are_the_multiples_of_the_headings_spacing_within_the_stops() -> None:
    eight = np.radians(np.arange(0, 360, 45))
    for stops, degrees in (
        ((-100, 190), [-90, -45, 0, 45, 90, 135, 180]),
        ((-270, 270), list(range(-270, 271, 45))),
        ((10, 100), [45, 90]),
    ):
        model = hpop.PanTilt(BASE, pan=tuple(map(math.radians, stops)))
        np.testing.assert_allclose(np.unique(np.degrees(model.stations(eight).states.pan)), degrees, atol=1e-9)
    np.testing.assert_allclose(np.unique(np.degrees(ALL_ROUND.stations(eight).states.pan)), np.arange(-135, 181, 45))
    np.testing.assert_allclose(np.unique(np.degrees(ALL_ROUND.stations(eight[::2]).states.pan)), [-90, 0, 90, 180])
    for tilt, tilts in (((-0.3, 0.5), [-0.3, 0.0, 0.5]), ((0.2, 0.6), [0.2, 0.4, 0.6]), ((0.1, 0.1), [0.1])):
        found = np.unique(hpop.PanTilt(BASE, tilt=tilt).stations(eight).states.tilt)
        np.testing.assert_allclose(found, tilts)


@pytest.mark.parametrize("model", [STOPPED, TILTING, ALL_ROUND])
@pytest.mark.parametrize("headings", [4, 8])
def test_every_turn_back_whose_pan_is_there_keeps_the_view(model: hpop.PanTilt, headings: int) -> None:
    stations = model.stations(np.radians(np.arange(0, 360, 360 / headings)))
    tails, heads = stations.motions["unwind"]
    before, after = (model.pose("camera", stations.states.take(ends)) for ends in (tails, heads))
    np.testing.assert_allclose(np.exp(1j * before.yaw), np.exp(1j * after.yaw), atol=1e-9)
    if model is ALL_ROUND:
        assert tails.size == stations.headings.size * (headings - 1)
    assert len({*zip(tails.tolist(), heads.tolist(), strict=True)}) == tails.size
    ends = [set(zip(*(ids.tolist() for ids in pair), strict=True)) for pair in stations.motions.values()]
    assert sum(map(len, ends)) == len(set().union(*ends))  # one motion between two stations


def test_sixteen_headings_and_stops_without_a_pan_are_refused() -> None:
    problem = hpop.Problem(WORLD, STOPPED, (0.5, 0.5, 0, 0, 0), (2.5, 1.5, None, None, None), ["rotation", "length"])
    with pytest.raises(OptionError, match="must be multiples of 45 degrees apart for a pan-tilt head, got 16 headings"):
        problem.solve("lattice", step=STEP, headings=16)
    narrow = hpop.PanTilt(BASE, pan=(0.1, 0.5))
    with pytest.raises(OptionError, match=r"multiple of 45 degrees, but none is .* pan=\(0\.1, 0\.5\) rad"):
        narrow.stations(np.radians(np.arange(0, 360, 45)))


def test_ends_that_are_no_stations_are_joined_by_what_base_and_head_do_in_turn() -> None:
    problem = hpop.Problem(WORLD, STOPPED, (0.5, 0.5, 0, 0.2, 0), (2.4, 1.4, 0.3, 1.0, None), ["rotation", "length"])
    front = problem.solve("lattice", step=STEP, headings=4)
    assert verify(problem, front) == []
    assert "by at most a turn, a move, a turn, a pan and a tilt" in front.certificate
    for trajectory in front.trajectories:
        assert trajectory.states.pan[0] == 0.2
        assert trajectory.states.pan[-1] == 1.0


def through(model: hpop.PanTilt, *rows: tuple[float, ...]) -> Trajectory:
    columns = np.array(rows, float).T
    return Trajectory.through(model, States(**dict(zip(model.space.names, columns, strict=True))))


def test_states_are_connected_by_the_base_first_and_then_the_head() -> None:
    looks = through(STOPPED, (0, 0, 0, 0, 0), (1, 0, 1.0, 3.0, 0), (1, 0, 1.0, -1.0, 0))
    assert looks.kinds == ("move", "turn", "pan", "pan")
    np.testing.assert_allclose(looks.states.pan, [0, 0, 0, 3, -1])
    tilted = through(TILTING, (0, 0, 0, 0, 0), (0, 2, np.nan, -1.0, 0.4))
    assert tilted.kinds == ("turn", "move", "pan", "tilt")
    kept = TILTING.connect(tilted.states.take([-1]), States(**dict.fromkeys(TILTING.space.names, np.array([np.nan]))))
    assert not any(leg.present.any() for leg in kept[-2:])
    round_about = through(ALL_ROUND, (0, 0, 0, 3.0, 0), (0, 0, 0, -3.0, 0))
    np.testing.assert_allclose(round_about.states.pan, [3.0, 2 * math.pi - 3.0])
