"""NumPy's numbers are taken wherever Python's are: answers of pandas, indices of argmin, arrays without axes."""

from __future__ import annotations

import json
from pathlib import Path

import networkx as nx
import numpy as np
import pytest
import shapely

import hpop
from hpop import drive, export, frontier, search, study
from hpop.criteria.others.metrics import zone_fractions
from hpop.goals import CameraAt, LookAt, ToolAt
from hpop.problems.named_rows import named_rows
from hpop.ros import planar_pose, pose_message
from hpop.study.statistics import multinomial, share
from hpop.trajectories.poses import poses
from hpop.world import Box, Cylinder, Future, Person, Sphere, Track, pose_at
from hpop.world.content.content import Content, Landmark, Zone
from tests.search.namoa_star import namoa_star

SQUARE = shapely.box(0, 0, 1, 1)
ROBOT = hpop.DifferentialDrive(radius=0.25)
WORLD = hpop.World.from_polygons([shapely.box(2, 1, 3, 3)], extent=shapely.box(0, 0, 5, 4)).with_content(
    people=[Person(4.5, 0.5, name="Ada"), Person(4.5, 3.5)]
)
PROBLEM = hpop.Problem(WORLD, ROBOT, (0.5, 2, 0), (4.5, 2, None), ["obstruction", "turns", "length"])
FRONT = PROBLEM.solve("lattice", step=0.5)
WAY = FRONT[0].trajectory
PATHS = search.Graph.from_arcs(3, [0, 1, 0], [1, 2, 2], [[1, 5], [1, 5], [9, 1]])
SSQ = study.Form.load("ssq")


def network(cost, quantum, source, target):
    graph = nx.DiGraph()
    graph.add_edge(0, 1, cost=cost, risk=1)
    graph.add_edge(1, 2, cost=cost, risk=1)
    made = search.Graph.from_networkx(graph, ["cost", "risk"], quanta={"cost": quantum})
    return search.pareto_paths(made, source, target).costs


def exported(folder, **options):
    files = export.save(PROBLEM, FRONT, folder, formats=["tum", "json"], **options)
    return [file.read_bytes() for file in files]


def designed(folder, rows, participants, seed):
    study.Design.of(FRONT, rows, participants=participants, consent="You ride along.", seed=seed).save(folder)
    return study.Design.load(folder).digest


def driven(choice, now, deadline, option, one):
    execution = drive.follow(PROBLEM, FRONT, choice)
    execution.options(now, deadline)
    execution.wish(turns=one)
    execution.take(option, now)
    return json.dumps(execution.record), execution.plan.states


def stopped(now, person, corner):
    execution = drive.follow(PROBLEM, FRONT, 0)
    execution.world(now, stop=person)
    execution.world(now, close=((4, 0), (corner, 0), (corner, 1)))
    return json.dumps(execution.record)


# Of each: a call, its arguments and its options, all numbers in which are replaced
DOORS = {
    "person": (Person, [1, 2.5, 0.5], {"velocity": (0.25, 1), "radius": 0.25, "spread": 0.5, "until": 5, "age": 1}),
    "future": (Future, [1], {"velocity": (0.5, 0), "until": 3, "x": 1, "y": 2, "yaw": 0.5}),
    "landmark": (Landmark, [1, 2], {"weight": 2}),
    "zone": (Zone, ["speed", SQUARE], {"limit": 0.5}),
    "groups": (lambda group: Content((Person(0, 0), Person(1, 1)), [group]).describe(), [(0, 1)], {}),
    "track": (lambda *given: vars(Track(*given)), [[0, 1, 2], [0, 0.5, 1], [0, 0, 0], True], {}),
    "waypoints": (lambda rows, t: Track.through(rows).later(t).times, [[(0, 0, 0), (4, 1, 0.5)], 1.5], {}),
    "robot": (hpop.DifferentialDrive, [], {"radius": 0.25, "camera_offset": (0.25, 0), "field_of_view": (1.5, 1)}),
    "footprint": (hpop.DifferentialDrive, [], {"footprint": ((-1, -1), (1, 0), (0, 1))}),
    "cells": (hpop.World.from_cells, [np.zeros((2, 2), bool), 0.5], {"origin": (1, 2, 0)}),
    "heights": (lambda heights: hpop.World.from_polygons([(SQUARE, heights)]).describe(), [(0, 2)], {}),
    "solids": (lambda a, b, c: (Box(a), Cylinder(b, c), Sphere(b)), [(1, 2, 0.5), 0.5, 2], {}),
    "pose": (pose_at, [(1, 2, 0.5)], {"quaternion": (0, 0, 0, 1)}),
    "problem": (
        lambda start, goal, **also: hpop.Problem(WORLD, ROBOT, start, goal, ["length"], **also),
        [(0.5, 2, 0), (4.5, 2, None)],
        {"quanta": {"length": 0.5}, "horizon": 5},
    ),
    "states by name": (
        lambda start, goals: hpop.Problem(WORLD, ROBOT, start, goals, ["length"]),
        [{"x": 0.5, "y": 2, "yaw": 0}, [[4.5, 2, None], [4.5, 3, 1]]],
        {},
    ),
    "goal": (lambda goal: hpop.Problem(WORLD, ROBOT, (0.5, 2, 0), goal, ["length"]), [(4.5, 2, 1)], {}),
    "later": (PROBLEM.at, [(1, 0.5, 0), 1], {}),
    "goals": (lambda a, b: (LookAt(a, b, 0.5), CameraAt(a), ToolAt(a)), [(1, 2, 1), (1, 2)], {}),
    "lattice": (
        lambda **options: PROBLEM.solve("lattice", **options).costs,
        [],
        {"step": 0.5, "headings": 8, "corner_cutting": False, "max_turns": 6, "tolerance": {"length": 0.5}},
    ),
    "roadmap": (lambda **options: PROBLEM.solve({"roadmap": options}).provenance, [], {"samples": 8, "seed": 1}),
    "obstruction": (lambda radius, z: WORLD.obstruction_field(radius, z)(1.0, 1.0), [1, 0.5], {}),
    "zone fractions": (lambda **options: zone_fractions(WAY, WORLD, **options), [], {"robot_radius": 0.5, "step": 0.5}),
    "table": (lambda **options: WAY.table(**options)["yaw"], [], {"step": 0.5, "executed": True}),
    "hold": (WAY.with_hold, [], {"at": 1, "seconds": 2}),
    "moment": (lambda t: (WAY.at(t), WAY.rates(t)), [0.5], {}),
    "from poses": (lambda through: hpop.Trajectory.from_poses(ROBOT, through), [[(1, 1, 0), (2, 2, 0)]], {}),
    "poses": (lambda **options: poses(WAY, **options).times, [], {"rate": 4, "planned": True}),
    "export": (exported, [Path], {"rows": [0, 1], "rate": 4, "planned": True}),
    "row": (lambda row: FRONT[row].costs, [1], {}),
    "slice": (lambda first: FRONT[first:].costs, [1], {}),
    "named rows": (named_rows, [FRONT, [1, "knee"]], {}),
    "where": (lambda turns: FRONT.where(turns=turns).costs, [int(FRONT.costs[0, 1])], {}),
    "choices": (
        lambda wish: [choose(wish).index for choose in (FRONT.nearest, FRONT.select, FRONT.reference_point)],
        [{"length": 1, "turns": 2}],
        {},
    ),
    "front": (
        lambda *given, **also: frontier.ItemFront.of(*given, **also).costs,
        [[[1, 2], [2, 1]], ["a", "b"]],
        {"quanta": [0.5, 0.5], "maximise": [True, False], "provenance": [{"seed": 1, "far": 0.5}, {"first": True}]},
    ),
    "hypervolume": (frontier.hypervolume, [[[1, 2], [2, 1]], [3, 3]], {}),
    "arcs": (
        lambda *given: search.Graph.from_arcs(*given).costs,
        [3, [0, 1, 0], [1, 2, 2], [[1, 5], [1, 5], [9, 1]]],
        {},
    ),
    "paths": (
        lambda *ends, **also: search.pareto_paths(PATHS, *ends, **also).costs,
        [0, 2],
        {"eps": 0.5, "tolerance": [1, 1]},
    ),
    "paths to several": (lambda *ends: search.pareto_paths(PATHS, *ends).costs, [0, [1, 2]], {}),
    "supported": (lambda *ends, **also: search.supported_paths(PATHS, *ends, **also).costs, [0, 2], {"divisions": 2}),
    "mean": (
        lambda *ends, **also: search.capped_mean_paths(PATHS, *ends, **also).costs,
        [0, 2],
        {"integral": 1, "duration": 0, "cap": 20},
    ),
    "namoa": (lambda *ends: namoa_star(PATHS, *ends), [0, 2], {}),
    "network": (network, [2, 1, 0, 2], {}),
    "score": (lambda answers: study.score(SSQ, answers), [{item.id: 1 for item in SSQ.items}], {}),
    "power": (study.power, [], {"effect": 0.5, "n": 10, "k": 2, "simulations": 200, "seed": 1, "alpha": 0.25}),
    "share": (share, [15, 148], {}),
    "multinomial": (multinomial, [[5, 1, 0]], {}),
    "design": (designed, [Path, [0, 1], 4, 3], {}),
    "pick": (study.pick, [FRONT, 2], {"always": [0]}),
    "prior": (study.Prior, [], {"sharpness": 2, "spread": 0.5, "random": 0.25, "concentration": (1, 2, 1)}),
    "preference": (
        lambda *given, **also: study.Preference.fit(FRONT, *given, **also).told(1, 0, 0).answers,
        [[(0, 1)]],
        {"ratings": {0: 1, 1: 2}, "ties": False, "seed": 1, "count": 1000},
    ),
    "pose message": (lambda **pose: planar_pose(pose_message(**pose)), [], {"x": 1, "y": 2, "yaw": 0.5}),
    "drive": (driven, [1, 0.5, 5, 0, 1], {}),
    "stopped": (stopped, [0.5, 0, 5], {}),
}  # fmt: skip


def wide(value):
    return {bool: np.bool_, int: np.int64, float: np.float64}[type(value)](value)


def narrow(value):
    return {bool: np.bool_, int: np.int32, float: np.float32}[type(value)](value)


def as_it_is(value):
    return value


def replaced(value, number):
    """Copy lists, tuples and dicts with each number as a NumPy scalar."""
    if isinstance(value, bool | int | float):
        return number(value)
    if type(value) in (list, tuple):
        return type(value)(replaced(one, number) for one in value)
    return {key: replaced(one, number) for key, one in value.items()} if type(value) is dict else value


@pytest.mark.cases(but=("drive", "stopped"))
@pytest.mark.parametrize("door", DOORS)
def test_numbers_of_numpy_do_what_those_of_python_do(tmp_path, door):
    call, given, also = DOORS[door]

    def done(number):
        folder = tmp_path / number.__name__
        folder.mkdir()
        return repr(
            call(*(folder if one is Path else replaced(one, number) for one in given), **replaced(also, number))
        )

    expected = done(as_it_is)
    for number in (wide, narrow, np.array):
        assert done(number) == expected
