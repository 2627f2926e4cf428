"""Right values for the arguments of public functions and methods, by type, by name, and by the class called on.

What is filled in by name has the name of a parameter, or the full name of one: "hpop.Front.of.items".
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi
import networkx as nx
import numpy as np
import shapely
from PIL import Image
from rosbags.typesys import Stores, get_typestore

import hpop
import hpop.preference.answers
from hpop import batches, export, motions, preference, ros, search, study
from hpop.base.symbols import lift
from hpop.planners.objectives import edge_objectives
from hpop.planners.spending import Spending
from hpop.search.timed import TimedGraph, timed_paths
from hpop.study import statistics
from hpop.trajectories.history import History
from hpop.world import Box, Person, Raster, Solid, pose_at
from hpop.world.content.content import Landmark
from tests.study.sessions import answered

SCENE = """name: room
world: {collision_objects: [{id: crate, header: {frame_id: world}, primitives: [{type: sphere, dimensions: [0.2]}],
  pose: {position: [1, 1, 1]}}]}
"""
ARM = Path(__file__).resolve().parents[1] / "examples/arm"


@dataclass
class Right:
    """Values by the type of a parameter, by its name, and by the class whose methods are called."""

    types: dict[str, Any]
    names: dict[str, Any]
    owners: dict[str, Any]


def right_values() -> Right:
    """Plan once in a room, and make values of all types of it; files are written to the current folder."""
    world = hpop.World.from_polygons([shapely.box(2, 1, 3, 3)], extent=shapely.box(0, 0, 5, 4))
    world = world.with_content(people=[Person(1, 3, 0)], landmarks=[Landmark(4, 3)])
    robot = hpop.DifferentialDrive(radius=0.2)
    problem = hpop.Problem(world, robot, (0.5, 2, 0), (4.5, 2, None), ["exposure", "turns", "length"])
    front = problem.solve(step=0.5)
    front.save("front.json")
    way = front.trajectories[0]
    _, moves = next(way.batches(world))
    states = way.states
    law = motions.laws_of(robot)[moves.law.kind]
    planner = hpop.Lattice(step=0.5)
    driven = hpop.follow(problem, front, 0)
    driven.save("drive.json")
    options = driven.options(0.0)
    graph = search.Graph.from_arcs(3, [0, 1, 0], [1, 2, 2], [[1, 2], [1, 2], [3, 1]])
    timed = TimedGraph(graph, np.ones(3, np.int32), 5)
    design = study.Design.of(front, [0, 1], participants=2, consent="You may stop.")
    Path("study").mkdir()
    design.save("study")
    answered(design, Path("study"), [person.id for person in design.enrolled])
    answers, form = study.Answers.load("study", design), design.questionnaires[0]
    person = preference.Preference.fit(front, [(0, 1)])
    person.save("person.json")
    planning = ros.GoalPlanner(problem, [planner], ros.Interface())
    solid = Solid(Box((1, 1, 1)), pose_at((0, 0, 0)))
    square, track = shapely.box(0, 0, 1, 1), hpop.Track(np.arange(3.0), np.arange(3.0), np.zeros(3))
    raster = Raster(np.zeros((5, 5), bool), 0.5)
    types: dict[str, Any] = {
        "World": world, "Model": robot, "Problem": problem, "Front": front, "Front[Any]": front, "Trajectory": way,
        "Trajectory | Front": way, "Front | Trajectory": way, "States": states, "Motions": moves, "Law": law,
        "History": lambda: History(world, way), "Column": np.array([0.1, 0.2]), "FloatArray": np.array([0.1, 0.2]),
        "FloatArray | float": 0.5, "IntArray": np.array([0]), "ArrayLike": [[1.0, 2.0], [2.0, 1.0]],
        "StateSpace": robot.space, "Pose": moves.camera.end, "Criterion": problem.criteria[0],
        "CriterionSpec": "length", "Sequence[CriterionSpec]": ["length"], "Sequence[Criterion]": problem.criteria,
        "tuple[Criterion, ...]": problem.criteria, "StateSpec": (0.5, 2, 0), "GoalSpec": (4.5, 2, None),
        "PlannerSpec": "lattice", "Iterable[PlannerSpec]": [planner], "Planner": planner,
        "Sequence[Planner]": [planner],
        "Candidates": lambda: planner.solve(problem), "Sequence[Trajectory]": front.trajectories,
        "Point | int | str | Preferring": 0, "Option | Point | int": 0, "str | os.PathLike[str]": "front.json",
        "str": "length", "float": 0.5, "int": 1, "bool": False, "Sequence[str]": ["length"],
        "Mapping[str, float]": {"length": 1.0}, "Mapping[str, Any]": {}, "Options": options, "Execution": driven,
        "Exported": export.Exported(way), "Graph": graph, "Graph | nx.Graph[Any]": graph, "Hashable": 0,
        "Hashable | Iterable[Hashable]": 2, "TimedGraph": timed, "Design": design, "Answers": answers, "Form": form,
        "Preference": person, "Sequence[Preference]": [person], "Track": track, "Person": world.content.people[0],
        "Sequence[Happening]": [], "BaseGeometry": square, "Polygon": square, "RNG": 0, "Mapping[Any, Any]": {},
        "np.random.Generator": lambda: np.random.default_rng(0), "Solid": solid, "Shape": solid.shape,
        "Heights": (0.0, 1.0), "tuple[float, float, float]": (1.0, 1.0, 1.0), "tuple[float, float]": (1.0, 2.0),
        "Iterable[Solid]": [solid], "PathServer": lambda: ros.PathServer(planning), "GoalPlanner": planning,
        "Interface": ros.Interface(), "Any": [[1, 2, 3], [2, 3, 1], [3, 1, 2]], "Sequence[float]": (0.0, 0.0, 0.0),
        "Iterable[BaseGeometry | tuple[BaseGeometry, Heights]]": [square], "Sequence[int]": [0, 1],
        "Sequence[Any]": [[1, 2, 3], [2, 3, 1]], "Iterable[Event]": [], "object": 0, "Collection[str]": ["camera"],
        "Sequence[Sequence[float]]": [(0, 0, 0), (1, 1, 0)], "Collision": robot.collision(world), "Path": Path("study"),
        "Twist": robot.twist("camera", states, states), "Iterable[Any]": [], "float | None": 0.5,
        "Ground": world.ground,
        "Sequence[tuple[float, float, float]]": [(0, 0, 0), (1, 1, 0)], "tuple[str, ...]": way.kinds,
        "Sequence[int | str | NamedRow]": [0, 1], "Sequence[int] | IntArray": [0], "CheckpointSpec": "checkpoint",
        "str | bytes": "{}", "BoolArray": np.zeros((5, 5), bool), "int | None": None, "PlanarPose | None": None,
        "Sequence[Trajectory] | Sequence[int]": [0, 1, 2], "Item": form.items[0], "Problem | None": problem,
        "Iterable[Shown]": [], "Mapping[str, Any] | None": None, "Trajectory | None": None,
        "type[W]": lambda: type(world),
        "FreeSpace": world.free_space(), "Iterable[str]": [], "Callable[[], T]": lambda: (lambda: 1),
        "tuple[Any, ...]": ("key",), "Group": "C", "Aggregate": "sum", "Rate": lambda: (lambda m: np.ones(len(moves))),
        "Mapping[int, Any]": {}, "ParetoPaths": search.pareto_paths(graph, 0, 2), "Goal": problem.goal,
    }  # fmt: skip
    names: dict[str, Any] = {
        "hpop.goals.goal.name": "mine", "hpop.model.name": "mine", "hpop.planners.planner.name": "mine",
        "hpop.criterion.name": "mine", "hpop.criterion.unit": "m", "body": "camera", "t": 0.5, "seconds": 1.0,
        "hpop.drive.load.path": "drive.json", "hpop.preference.Preference.load.path": "person.json", "folder": "study",
        "hpop.export.save.folder": "out", "hpop.study.save_stimuli.folder": "out", "hpop.export.write.path": "a.tum",
        "participant": "p01", "letter": "A", "deadline": 5.0, "form": form.id, "hpop.study.score.form": form,
        "hpop.DifferentialDrive.body.name": "camera", "hpop.PanTilt.body.name": "camera",
        "hpop.Motions.body.name": "camera", "yaw": np.array([0.1, 0.2]), "hpop.motions.StateSpace.called.name": "x",
        "hpop.motions.integrated.name": "length", "hpop.study.power.effect": 0.5, "count": 2, "stimuli": 2, "total": 3,
        "hpop.frontier.hypervolume.reference": [3.0, 3.0], "pieces": np.array([0, 1]), "hpop.Motions.moments.pieces": 2,
        "hpop.Front.of.items": list(front.trajectories), "hpop.Front.of.costs": front.costs, "quanta": [1.0, 1.0],
        "hpop.Front.where.named": {"length": "<=100"}, "hpop.Front.where.conditions_by_name": {"length": "<=100"},
        "hpop.Front.select.weights": {"length": 1.0}, "shares": {"length": 1.0}, "also": [], "metres_a_radian": 0.5,
        "hpop.Problem.from_description.description": problem.describe(), "hpop.Problem.at.state": (0.5, 2, 0),
        "hpop.World.from_description.description": world.describe(), "hpop.World.from_cells.resolution": 0.1,
        "hpop.Trajectory.from_description.description": way.describe(), "hpop.models.driven.driven.pose": (0, 0, 0),
        "hpop.models.driven.driven.controls": [(1.0, 1.0, 0.0)], "corners": ((0, 0), (1, 0), (1, 1)), "z_min": 0.0,
        "z_max": 1.0, "hpop.motions.StateSpace.bounded.bounds": (0.0, 1.0), "hpop.world.Solid.pose": np.eye(4),
        "hpop.world.Hull.points": np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]),
        "hpop.search.timed.timed_paths.source": 0, "hpop.search.pareto_paths.source": 0,
        "hpop.search.supported_paths.source": 0,
        "hpop.search.Prepared.least_ways.source": 0, "hpop.search.Prepared.paths.source": 0,
        "hpop.world.Field.values": np.zeros((3, 3)), "directions": np.array([[1.0, 0, 0]]), "times": np.array([0.0, 1]),
        "hpop.Track.x": np.array([0.0, 1]), "hpop.Track.y": np.array([0.0, 1]), "given": (1, 1, 0), "level": 0.9,
        "hpop.testing.random_motions.kind": "straight", "position": (4.0, 3.0, 1.0), "distance": (1.0, 2.0),
        "hpop.Trajectory.kinds": way.kinds, "tails": [0], "heads": [1],
        "hpop.search.Graph.from_arcs.costs": [[1]], "share": np.array([0.5]), "hpop.search.Prepared.close.arcs": [0],
        "hpop.search.Prepared.open.arcs": [0], "wish": "length", "hpop.drive.Execution.wish.wish": "length",
        "hpop.study.Design.of.participants": 2, "chosen_row": 0, "hpop.study.Answers.matrix.score": "total",
        "score": "total",
        "hpop.study.analyse.score": (form.id, form.scores[0].name), "chosen": [0, 1], "first": [0, 1], "second": [1, 0],
        "hpop.preference.Preference.told.first": 0, "hpop.preference.Preference.told.second": 1,
        "hpop.preference.Preference.told.chosen": 0, "hpop.export.tum.given": export.Exported(way),
    }  # fmt: skip
    names |= {f"hpop.export.{one}.given": export.Exported(way) for one in export.__all__}
    owners: dict[str, Any] = {
        "hpop.Front": front, "hpop.Trajectory": way, "hpop.Problem": problem, "hpop.World": world,
        "hpop.Motions": moves,
        "hpop.DifferentialDrive": robot, "hpop.Lattice": planner, "hpop.Person": Person(1, 1, 0, velocity=(1, 0)),
        "hpop.Planning": hpop.Planning(world, robot, ["turns", "length"]),
        "hpop.Track": track, "hpop.drive.Execution": driven,
        "hpop.drive.Options": options, "hpop.search.Graph": graph, "hpop.search.ParetoPaths": types["ParetoPaths"],
        "hpop.preference.Preference": person, "hpop.preference.Prior": preference.Prior(),
        "hpop.preference.People": preference.People([person]), "hpop.study.Design": design, "hpop.study.Form": form,
        "hpop.study.Answers": answers, "hpop.planners.Candidates": types["Candidates"],
        "hpop.ros.GoalPlanner": planning,
        "hpop.search.Prepared": lambda: search.Prepared(graph, 2), "hpop.ros.PathServer": types["PathServer"],
        "hpop.world.Ground": world.ground, "hpop.world.Raster": raster, "hpop.motions.StateSpace": robot.space,
        "hpop.motions.States": states, "hpop.frontier.ItemFront": hpop.frontier.ItemFront.of([[1.0, 2], [2, 1]]),
        "hpop.search.timed.TimedPaths": timed_paths(timed, 0, 2), "hpop.models.base.PlanarModel": robot,
        "hpop.study.Analysis": lambda: study.analyse(design, answers), "hpop.world.Field": world.clearance_field(),
        "hpop.study.statistics.Strengths": statistics.bradley_terry([0, 1] * 2, [1, 0] * 2, [0, 0, 1, 1], stimuli=2),
        "hpop.export.Exported": export.Exported(way), "hpop.export.Frames": export.Frames(),
        "hpop.world.Box": Box((1, 1, 1)),
        "hpop.world.Cylinder": hpop.world.Cylinder(1, 1), "hpop.world.Sphere": hpop.world.Sphere(1),
        "hpop.goals.GoalSet": lambda: hpop.Problem(world, robot, (0.5, 2, 0), [(4, 2, 0), (4, 3, 0)], ["length"]).goal,
    }  # fmt: skip
    right = Right(types, names, owners)
    _add_arms(right, world)
    _add_files(right)
    _add_searches(right)
    _add_rest(right)
    return right


def _add_arms(right: Right, world: hpop.World) -> None:
    """Values for the methods of robots that have joints, or a head that turns."""
    arm = hpop.SerialArm.from_urdf(ARM / "arm6.urdf", tip="tool", acceleration=6.0, srdf=ARM / "arm6.srdf")
    moving = hpop.MobileArm(arm, hpop.DifferentialDrive(radius=0.2, body_height=0.4))
    turning_head = hpop.PanTilt(hpop.DifferentialDrive())
    for owner, model, kind in (
        ("SerialArm", arm, "reach"), ("MobileArm", moving, "reach"), ("PanTilt", turning_head, "pan"),
    ):  # fmt: skip
        law = motions.laws_of(model)[kind]
        states = model.space.sample(0, 2)
        first = states.take(np.array([0, 0]))
        ends = {name: getattr(states if name in law.varies else first, name) for name in states.names}
        way = hpop.Trajectory(model, motions.States(**ends), (law.kind,))
        ((_, moves),) = way.batches(world)
        start, end = moves.start, moves.end
        right.owners[f"hpop.{owner}"] = model
        right.types |= {
            f"hpop.{owner}: {type_}": value
            for type_, value in {"States": start, "Law": law, "Trajectory": way, "Motions": moves}.items()
        }
        right.names |= {f"hpop.{owner}.{method}.name": "camera" for method in ("body", "pose", "twist", "twist_rate")}
        right.names |= {f"hpop.{owner}.connect.a": start, f"hpop.{owner}.connect.b": end}
        right.names |= {f"hpop.{owner}.doubtful.start": start, f"hpop.{owner}.doubtful.end": end}
        right.names |= {f"hpop.{owner}.wheels.times": np.array([0.0])}
        if owner == "SerialArm":
            for criterion in ("JointEnergy", "JointLength", "JointLimits", "Singularity"):
                right.names[f"hpop.criteria.{criterion}.cost.m"] = moves
    right.names |= {
        "hpop.MobileArm.arm": arm, "hpop.SerialArm.urdf": str(ARM / "arm6.urdf"), "hpop.SerialArm.tip": "tool",
        "hpop.SerialArm.acceleration": 6.0, "hpop.SerialArm.from_urdf.path": str(ARM / "arm6.urdf"),
        "hpop.SerialArm.from_urdf.parameters": {"tip": "tool", "acceleration": 6.0},
        "hpop.PanTilt.stations.yaw": np.arange(4) * np.pi / 2,
    }  # fmt: skip


def _add_files(right: Right) -> None:
    """Small files of each kind that is read."""
    room = {"type": "Polygon", "coordinates": [[[0, 0], [5, 0], [5, 4], [0, 4], [0, 0]]]}
    Path("room.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": [
        {"type": "Feature", "properties": {"height": 2}, "geometry": room}]}))  # fmt: skip
    Image.fromarray(np.full((20, 30), 255, np.uint8)).save("room.png")
    Path("room.map").write_text("type octile\nheight 3\nwidth 4\nmap\n....\n.@@.\n....\n")
    Path("room.yaml").write_text(
        "image: room.png\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.2\n"
    )
    Path("scene.yaml").write_text(SCENE)
    Path("people.csv").write_text("t,id,x,y\n0,1,0,0\n1,1,1,0\n0,2,3,3\n1,2,3,2\n")
    world = hpop.World.from_image("room.png", resolution=0.1)
    right.names |= {
        "hpop.World.from_file.path": "room.geojson", "hpop.World.from_file.options": {},
        "hpop.World.from_geojson.path": "room.geojson", "hpop.World.from_image.path": "room.png", "resolution": 0.1,
        "hpop.World.from_moveit_scene.path": "scene.yaml", "hpop.World.from_movingai.path": "room.map",
        "hpop.World.from_ros_map.path": "room.yaml", "hpop.read_tracks.path": "people.csv",
        "hpop.World.read_from.source": world.source,
    }  # fmt: skip
    right.owners["hpop.World.read_from"] = world


def _add_searches(right: Right) -> None:
    """Values for the parts of planners and of searches in graphs."""
    graph, problem, way = (right.types[kind] for kind in ("Graph", "Problem", "Trajectory"))
    objectives, spending = edge_objectives(problem.criteria, "lattice"), lambda: Spending()
    means = lambda: search.capped_mean_paths(graph, 0, 2, integral=0, duration=1, cap=9)  # noqa: E731
    csr = {"indptr": [0, 1, 2, 2], "heads": [1, 2], "costs": [[1, 2], [3, 4]]}
    network = nx.DiGraph()
    network.add_edge(0, 1, cost=1)
    named = search.Graph.from_networkx(network, ["cost"])
    right.types |= {"Objectives": objectives, "Spending": spending}
    right.owners |= {
        "hpop.planners.AnyAngle": hpop.planners.AnyAngle(step=0.5),
        "hpop.planners.Roadmap": hpop.planners.Roadmap(samples=50),
        "hpop.search.MeanPaths": means, "hpop.search.Graph.node": named,
        "hpop.search.timed.TimedGraph": right.types["TimedGraph"],
    }  # fmt: skip
    right.names |= {
        "hpop.Lattice.ends.lattice": lambda: hpop.Lattice(step=0.5).build(problem, objectives, Spending()).ends.space,
        "hpop.Lattice.first_answer.built": lambda: hpop.Lattice(step=0.5).build(problem, objectives, Spending()),
        "hpop.planners.AnyAngle.roadmap.first": right.types["Candidates"],
        **{f"hpop.search.Graph.from_csr.{name}": value for name, value in csr.items()},
        "hpop.search.Graph.from_arcs.costs": [[1], [1]], "hpop.search.Graph.from_arcs.heads": [1, 2],
        "hpop.search.Graph.from_arcs.tails": [0, 1], "hpop.search.Graph.from_arcs.n": 3,
        "hpop.search.Graph.extended.nodes": 4, "hpop.search.Graph.extended.tails": np.array([2]),
        "hpop.search.Graph.extended.heads": np.array([3]), "hpop.search.Graph.extended.costs": np.array([[1, 1]]),
        "hpop.search.Graph.without.left_out": np.array([True, False, False]), "hpop.search.Graph.node.label": 0,
        "hpop.search.Graph.from_networkx.g": network, "hpop.search.Graph.from_networkx.costs": ["cost"],
        "hpop.search.capped_mean_paths.integral": 0, "hpop.search.capped_mean_paths.duration": 1,
        "hpop.search.capped_mean_paths.cap": 9,
        "hpop.search.MeanPaths.select.costs": np.array([[1]]),
        **{f"hpop.search.MeanPaths.{of}.rows": np.array([0]) for of in ("select", "through")},
        "hpop.search.MeanPaths.suffixes.node": 0,
        **{f"hpop.search.MeanPaths.{of}.i": 0 for of in ("arcs", "edges", "mean", "nodes", "path")},
        "hpop.search.timed.TimedGraph.durations": np.ones(3, np.int32), "hpop.search.timed.TimedGraph.horizon": 5,
        **{f"hpop.search.Graph.{name}": getattr(graph, name) for name in ("indptr", "heads", "costs", "arc")},
        "hpop.search.Graph.aggregates": ("sum", "sum"), "quantum": 1.0,
    }  # fmt: skip
    rate = lambda m: np.ones_like(m.camera.x)  # noqa: E731
    right.names |= {"hpop.Motions.integrate.rate": lambda: rate, "hpop.Motions.worst.rate": lambda: rate}
    right.names |= {"hpop.Trajectory.cut.pieces": np.ones(len(way), np.int64)}


def _add_rest(right: Right) -> None:
    """Values for goals, motions, solids, studies and messages, each by the name of a parameter."""
    types, names, owners = right.types, right.names, right.owners
    problem, front, way, design, form = (types[kind] for kind in ("Problem", "Front", "Trajectory", "Design", "Form"))
    world = types["World"]
    camera_at = hpop.goals.CameraAt((4.0, 2.0, 1.2))
    look_at = hpop.goals.LookAt((4.0, 3.0, 1.0), (1.0, 2.0))
    some_law, held = motions.laws_of(problem.model)["move"], motions.States(clock=np.array([0.0, 1.0]))
    talking = world.with_content(people=[Person(1, 3, 0), Person(1, 2, 0)], groups=[(0, 1)])
    pose = problem.model.pose("camera", way.states)
    x, y = (lift(casadi.MX.sym(name, 1), 1) for name in "xy")
    store = get_typestore(Stores.ROS2_JAZZY)
    fitted = study.fit_criterion([1, 2, 3], [0, 1, 2], problem, ["length"], front=front, source="nobody")
    fitted.save("learnt.json")
    field, shares = world.clearance_field(), np.array([[0.25, 0.75]])
    saved = hpop.frontier.ItemFront.of([[1.0, 2], [2, 1]])
    saved.save("plain.json")
    results = batches.batch([problem], [{"lattice": {"step": 1.0}}], out="batch")
    types |= {"Results": results, "PlannerSummary": batches.summaries(results)[0]}
    owners |= {
        "hpop.criteria.Learnt": lambda: hpop.criteria.Learnt("learnt.json"),
        "hpop.criteria.LookAtCriterion": lambda: hpop.criteria.LookAtCriterion(target=(4.0, 3.0, 1.0)),
        "hpop.criteria.Occlusion": lambda: hpop.criteria.Occlusion(target=(4.0, 3.0, 1.0)),
        "hpop.criteria.ViewDistance": lambda: hpop.criteria.ViewDistance(target=(4.0, 3.0, 1.0)),
        "hpop.goals.CameraAt": camera_at, "hpop.goals.CameraAt.states": camera_at, "hpop.goals.LookAt": look_at,
        "hpop.goals.Region": look_at, "hpop.batches.Results": results,
        "hpop.batches.PlannerSummary": types["PlannerSummary"],
        "hpop.goals.AnyOf": hpop.goals.AnyOf(camera_at, look_at), "hpop.study.Fitted": fitted,
        "hpop.models.base.Part": hpop.models.base.Part(((0.0, 0.0),), 0.2, 0.0, 1.0),
        "hpop.motions.Phase": motions.Phase(np.ones(2), np.zeros(2), np.ones(2), "cruise"),
        "hpop.world.Hull": hpop.world.Hull(names["hpop.world.Hull.points"]),
        "hpop.world.Field": field, "hpop.preference.Prior": preference.Prior(),
    }  # fmt: skip
    names |= {
        **{f"hpop.Front.{key}": value for key, value in vars(front).items()},
        **{f"hpop.frontier.ItemFront.{key}": value for key, value in vars(saved).items()},
        "hpop.Front.of.costs": front.costs, "hpop.Front.select.weights": {"length": 1.0},
        "hpop.batches.Results.folder": "batch", "hpop.view.draw_batch.path": Path("figure.png"),
        "hpop.frontier.ItemFront.load.path": "plain.json", "hpop.frontier.dominates.a": [1.0, 2.0],
        "hpop.frontier.dominates.b": [2.0, 1.0], "hpop.Person.along.others": {},
        "hpop.criteria.Learnt.file": "learnt.json",
        "hpop.criteria.OSpace.centre.group": (Person(1, 1, 0), Person(2, 1, 0)),
        "hpop.goals.CameraAt.position": (4.0, 2.0, 1.2), "hpop.goals.GoalSet.members": ((4.0, 2.0, 0.0),),
        "hpop.goals.LookAt.target": (4.0, 3.0, 1.0),
        "hpop.motions.Hold.interpolate.name": "clock", "hpop.motions.Hold.interpolate.start": held,
        "hpop.motions.Hold.interpolate.end": held, "hpop.motions.Hold.phases.start": held,
        "hpop.motions.Hold.phases.end": held, "hpop.motions.slopes.name": "x", "hpop.motions.slopes.law": some_law,
        "hpop.motions.integrated.name": "camera", "hpop.motions.StateSpace.checked.name": "x",
        "hpop.motions.StateSpace.checked.value": 1.0, "hpop.motions.StateSpace.names": ("x",),
        "hpop.motions.StateSpace.units": ("m",), "hpop.motions.StateSpace.low": (0.0,),
        "hpop.motions.StateSpace.high": (1.0,), "hpop.motions.StateSpace.weights": (1.0,),
        "hpop.preference.Preference.expected.costs": front.costs,
        "hpop.preference.Prior.on.measures": [preference.answers.Measure("length", "m", 1.0)],
        **{f"hpop.preference.Prior.{of}.shares": shares for of in ("log_density", "log_densities")},
        "sharpness": np.array([1.0]), "ties": np.array([0.5]),
        "hpop.ros.Bridge.url": "ws://localhost:9090", "hpop.ros.PathServer.connected.send": lambda: (lambda text: None),
        "hpop.ros.Bridge.server": types["PathServer"],
        "hpop.ros.messages.message": {"sec": 1, "nanosec": 2}, "hpop.ros.messages.kind": "builtin_interfaces/msg/Time",
        "hpop.ros.messages.store": store, "hpop.ros.plain.message": store.types["builtin_interfaces/msg/Time"](1, 2),
        "hpop.drive.Execution.take_again.event": {"now": 1.0, "place": 0, "stands": 0.0},
        "hpop.drive.Execution.take_again.way": None,
        "hpop.ros.planar_pose.message": ros.pose_message(1.0, 2.0, 0.5), "hpop.ros.pose_message.yaw": 0.5,
        "hpop.ros.pose_message.x": 0.5, "hpop.ros.pose_message.y": 0.5,
        "hpop.ros.trajectory_of.path": ros.path_message(way),
        "hpop.study.Analysis.save.folder": "report", "hpop.study.Design.form.name": form.id,
        "hpop.study.Design.participant.name": "p01", "hpop.study.Fitted.save.path": "again.json",
        "hpop.study.Form.from_dict.values": form.to_dict(), "hpop.study.Form.item.name": form.items[0].id,
        "hpop.study.fit_criterion.ratings": [1, 2, 3],
        "hpop.study.fit_criterion.trajectories": list(front.trajectories[:3]),
        "hpop.study.score.values": {item.id: 0 for item in form.items}, "hpop.study.session_page.folder": Path("study"),
        "hpop.study.session_page.public": design.public("p01"), "hpop.study.statistics.adjusted.p": [0.01, 0.2],
        "hpop.study.statistics.Strengths.chance.first": 0, "hpop.study.statistics.Strengths.chance.second": 1,
        "hpop.study.statistics.cochran.values": [[1, 0, 1], [1, 1, 0], [0, 0, 1]],
        "hpop.study.statistics.describe.values": [1.0, 2.0, 3.0], "hpop.study.Answers.sessions": (),
        "hpop.testing.random_motions.kind": "move", "hpop.testing.random_motions.size": 3,
        "hpop.world.Field.at.places": lambda: field.places(x, y),
        "hpop.world.Field.places.x": x, "hpop.world.Field.places.y": y,
        "hpop.world.Raster.to_world.column": np.array([1]), "hpop.world.Raster.to_world.row": np.array([1]),
        "hpop.world.Ground.extent": shapely.box(0, 0, 1, 1), "hpop.world.Solid.build.data": types["Solid"].describe(),
        "hpop.world.content.content.Content.build.data": world.content.describe(),
        "hpop.world.content.content.Zone.kind": "keep-out",
        "hpop.world.content.content.Zone.area": shapely.box(0, 0, 1, 1),
        "hpop.drive.Execution.world.now": 1.0, "hpop.drive.Execution.world.close": shapely.box(0.1, 3.6, 0.2, 3.7),
        "hpop.motions.Phase.part.first": np.zeros(2), "hpop.motions.Phase.part.last": np.ones(2),
        "hpop.Front.where.conditions_by_name": {}, "hpop.goals.LookAt.rates.pose": pose,
        "hpop.goals.CameraAt.rates.pose": pose, "hpop.goals.Region.rates.pose": pose,
        "hpop.criteria.OSpace.cost.m": next(way.batches(talking))[1],
        "hpop.drive.Options.place_of.chosen": 0, "hpop.drive.Options.select.weights": {"length": 1.0},
    }  # fmt: skip
