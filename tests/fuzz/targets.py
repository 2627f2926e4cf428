"""What is thrown at: readers, scenarios, fronts, checkpoints, the Python interface and the command line."""

from __future__ import annotations

import dataclasses
import io
import json
import re
import warnings
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import shapely
import trimesh
import yaml
from click.testing import CliRunner
from harness import Attempt, Target, Wrong
from mutations import Rng, bent_bytes, bent_tree, hostile
from PIL import Image
from verdicts import CONTROLS, asked, shown, verdict

import hpop
from hpop.apart import child
from hpop.cli import main
from hpop.registry import criteria, models, planners
from hpop.ros import Interface, Planning, path_message, pose_message, protocol, trajectory_of
from hpop.scenario import load_scenario
from hpop.search import Graph, pareto_paths
from hpop.search.machinery.checkpoint import CHECKSUM, LENGTH, MAGIC
from hpop.status import Budget, Status
from hpop.verify import verify
from hpop.world import Box, Cylinder, Hull, Person, Solid, pose_at
from hpop.world.predictions import bounded
from tests import plans

SOFTEST = 0.5  # share of inputs whose bytes are bent; the others' structure is

ROOM: dict[str, Any] = {
    "world": {"polygons": {"extent": [[0, 0], [6, 0], [6, 4], [0, 4]], "obstacles": []}},
    "model": {"differential_drive": {"radius": 0.3, "camera_height": 1.2, "speed": 1.0}},
    "start": [1.0, 1.0, 0],
    "goal": [5.0, 3.0, "any"],
    "criteria": ["obstruction", "turns", {"enclosure": {"radius": 3.0}}, "length"],
    "planner": {"lattice": {"step": 0.5, "headings": 8, "eps": 0.0, "time_limit": 2.0, "max_labels": 100_000}},
    "people": [{"x": 3.0, "y": 3.5, "yaw": "90 deg", "name": "Ada"}, {"x": 3.5, "y": 3.5, "yaw": 0}],
    "groups": [["Ada", 1]],
    "landmarks": [{"x": 5.5, "y": 2.0, "z": 1.6, "facing": "180 deg", "weight": 2, "name": "door"}],
    "zones": [{"kind": "speed", "area": [[3, 1], [4, 1], [4, 2]], "limit": 0.5}],
}
ROOM["world"]["polygons"]["obstacles"] = [{"corners": [[2, 1], [3, 1], [3, 2], [2, 2]], "height": [0, 1.5]}]
PLANNERS: list[dict[str, dict[str, Any]]] = [
    ROOM["planner"],
    {"lattice": {"step": 0.5, "max_turns": 6, "tolerance": {"length": 0.1}, "max_memory": 10**9}},
    {"lattice": {"step": 0.5, "max_detour": 1.1, "time_limit": 2.0}},
    {"weighted-sum": {"step": 0.5, "divisions": 4}},
    {"roadmap": {"samples": 60, "neighbours": 6, "seed": 1, "time_limit": 2.0}},
    {"any-angle": {"step": 0.5, "max_positions": 60, "time_limit": 2.0}},
]
GEOJSON = {
    "type": "FeatureCollection",
    "features": [
        {
            "type": "Feature",
            "properties": {"name": "case", "height": 2},
            "geometry": {"type": "Polygon", "coordinates": [c]},
        }
        for c in ([[0, 0], [9, 0], [9, 7], [0, 7], [0, 0]], [[2, 2], [3, 2], [3, 3], [2, 3], [2, 2]])
    ]
    + [
        {"type": "Feature", "properties": {"landmark": True}, "geometry": {"type": "Point", "coordinates": [4, 4]}},
        {"type": "Feature", "properties": None, "geometry": {"type": "LineString", "coordinates": [[1, 1], [5, 5]]}},
    ],
}
ROS_MAP = {
    "image": "map.pgm",
    "resolution": 0.1,
    "origin": [-1.0, -2.0, 0.0],
    "negate": 0,
    "occupied_thresh": 0.65,
    "free_thresh": 0.196,
    "mode": "trinary",
}
SOLIDS = {
    "extent": [[0, 0], [6, 0], [6, 4], [0, 4]],
    "obstacles": [
        {"box": [1.0, 1.0, 0.75], "position": [2.5, 1.5, 0.375], "rpy": [0, 0, "30 deg"], "name": "table"},
        {"cylinder": {"radius": 0.1, "length": 1.0}, "position": [4, 1, 0.5], "quaternion": [0, 0.1, 0, 1]},
        {"sphere": 0.2, "position": [4, 3, 1]},
        {"hull": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], "position": [5, 2, 0]},
    ],
}
BLOCK: dict[str, Any] = {
    "vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "triangles": [{"vertex_indices": list(face)} for face in ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))],
}
SCENE = {
    "robot_state": {"attached_collision_objects": []},
    "world": {
        "octomap": {"octomap": {"data": []}},
        "collision_objects": [
            {
                "id": "table",
                "header": {"frame_id": "world"},
                "primitives": [
                    {"type": "box", "dimensions": [2, 1, 0.1]},
                    {"type": "cylinder", "dimensions": [1, 0.1]},
                ],
                "primitive_poses": [{"position": [0, 0, z], "orientation": [0, 0.3, 0, 1]} for z in (0.75, 0.35)],
                "pose": {"position": {"x": 1, "y": 2, "z": 0}, "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}},
            },
            {"id": "ball", "header": {"frame_id": "world"}, "primitives": [{"type": 2, "dimensions": [0.2]}]},
            {"id": "block", "header": {"frame_id": "world"}, "meshes": [BLOCK], "operation": 0},
        ],
    },
}


# Readers


def _written(path: Path, tree: Any, rng: Rng, dump: Callable[[Any], str]) -> Path:
    """A tree, bent as a whole or in its bytes, in a file."""
    if rng.random() < SOFTEST:
        data = bent_bytes(dump(tree).encode(), rng)
    else:
        data = dump(bent_tree(tree, rng, most=int(rng.integers(1, 4)))).encode("utf-8", "surrogatepass")
    path.write_bytes(data)
    return path


def _json(tree: Any) -> str:
    return json.dumps(tree, ensure_ascii=bool(len(str(tree)) % 2), default=str)


def _yaml(tree: Any) -> str:
    try:
        return yaml.safe_dump(tree, allow_unicode=True, sort_keys=False)
    except RecursionError:  # the writer's, for lists within lists within lists
        return "[" * 5000


def _looked_at(world: hpop.World) -> None:
    """What everybody does with a world first."""
    x0, y0, x1, y1 = world.bounds
    world.clearance(np.linspace(x0, x1, 5), np.linspace(y0, y1, 5))
    json.dumps(world.describe(), allow_nan=False)
    repr(world)
    asked(lambda: world.bodies)


def geojson(rng: Rng, folder: Path) -> str:
    path = _written(folder / "plan.geojson", GEOJSON, rng, _json)
    meaning = ("obstacles", "free", "outline")[rng.integers(3)]
    options = {("units", "wall_width", "origin")[rng.integers(3)]: hostile(rng)} if rng.random() < 0.3 else {}
    wide = {"wall_width": 0.1, **options}
    return verdict(lambda: _looked_at(hpop.World.from_geojson(path, polygons=meaning, **wide)))  # type: ignore[arg-type]


def ros_map(rng: Rng, folder: Path) -> str:
    pixels = rng.choice([0, 205, 254], size=(20, 30)).astype(np.uint8)
    picture = b"P5\n# map\n30 20\n255\n" + pixels.tobytes()
    (folder / "map.pgm").write_bytes(bent_bytes(picture, rng) if rng.random() < 0.5 else picture)
    path = _written(folder / "map.yaml", ROS_MAP, rng, _yaml)
    return verdict(lambda: _looked_at(hpop.World.from_ros_map(path)))


def movingai(rng: Rng, folder: Path) -> str:
    rows = "\n".join("".join(row) for row in rng.choice(list(".@GTW"), size=(12, 16)))
    path = folder / "grid.map"
    path.write_bytes(bent_bytes(f"type octile\nheight 12\nwidth 16\nmap\n{rows}\n".encode(), rng))
    return verdict(lambda: _looked_at(hpop.World.from_movingai(path)))


TRACKS = (
    "# framerate: 25 fps\n# id frame x/cm y/cm z/cm\n"
    + "".join(f"{i % 3} {i} {10 * i} 150.5 176\n" for i in range(30)),
    "id,t,x [mm],y [mm]\n" + "".join(f"{'Ada' if i % 2 else 7},{0.1 * i:.1f},{40 * i},1500\n" for i in range(30)),
    "".join(f"{6.0 * i:.7e} {1.0 + i % 3} {0.5 * i} 0.0 3.5 1.2 0.0 0.1\n" for i in range(30)),
)


def tracks(rng: Rng, folder: Path) -> str:
    path = folder / "people.txt"
    path.write_bytes(bent_bytes(TRACKS[rng.integers(len(TRACKS))].encode(), rng))
    options = {("frame_rate", "unit", "format", "ids")[rng.integers(4)]: hostile(rng)} if rng.random() < 0.3 else {}

    def walk() -> None:
        people = [Person.along(track) for track in hpop.read_tracks(path, **options).values()]
        world = hpop.World.from_polygons([], extent=shapely.box(0, 0, 20, 5)).with_content(people=people)
        cut, _ = bounded(world, horizon=3.0)
        for person in cut:
            json.dumps(person.later(1.0).way().tolist(), allow_nan=False)
        json.dumps(world.describe(), allow_nan=False)

    return verdict(walk)


def moveit_scene(rng: Rng, folder: Path) -> str:
    path = _written(folder / "scene.yaml", SCENE, rng, _yaml)
    return verdict(lambda: _looked_at(hpop.World.from_moveit_scene(path)))


def image(rng: Rng, folder: Path) -> str:
    buffer = io.BytesIO()
    kind = ("PNG", "PPM", "BMP", "GIF")[rng.integers(4)]
    Image.fromarray(rng.choice([0, 255], size=(16, 20)).astype(np.uint8)).save(buffer, kind)
    path = folder / "plan.png"
    path.write_bytes(bent_bytes(buffer.getvalue(), rng))
    resolution = hostile(rng) if rng.random() < 0.3 else 0.1
    options = {("smallest_obstacle", "inside")[rng.integers(2)]: hostile(rng)} if rng.random() < 0.3 else {}
    return verdict(lambda: _looked_at(hpop.World.from_image(path, resolution, **options)))


def dxf(rng: Rng, folder: Path) -> str:
    """A drawing with bent bytes, or hostile options; read here, where memory and time are bounded as well."""
    path = folder / "plan.dxf"
    path.write_bytes(bent_bytes(plans.dxf(_drawn), rng))
    options = {("scale", "layers", "wall_width", "inside")[rng.integers(4)]: hostile(rng)} if rng.random() < 0.3 else {}
    with _read_here():
        return verdict(lambda: _looked_at(hpop.World.from_file(path, **options)))


def _drawn(drawing: Any) -> None:
    space = drawing.modelspace()
    space.add_lwpolyline([(0, 0, 0.3), (6, 0, 0), (6, 4, 0), (0, 4, -1)], format="xyb", close=True)
    space.add_circle((3, 2), 0.5, dxfattribs={"layer": "COLUMNS"})
    space.add_spline([(1, 1), (2, 2), (3, 1)])
    space.add_hatch().paths.add_polyline_path([(4, 1), (5, 1), (5, 2)], is_closed=True)
    drawing.blocks.new("TABLE").add_ellipse((0, 0), (0.4, 0), 0.5)
    space.add_blockref("TABLE", (1, 3), dxfattribs={"rotation": 30, "column_count": 2, "column_spacing": 1})


def pdf(rng: Rng, folder: Path) -> str:
    """A page with bent bytes, in the process that is meant to break down where pdfium does."""
    form = plans.stream(b"0 0 m 9 0 l 9 9 9 9 0 9 c S", b"/Type /XObject /Subtype /Form /BBox [0 0 99 99]")
    content = b"1 w 50 50 m 350 50 l 350 250 l 50 250 l s q 2 0 0 2 90 90 cm /X Do Q 0.2 g 100 200 30 30 re f"
    path = folder / "plan.pdf"
    path.write_bytes(bent_bytes(plans.pdf(content, resources=b"/XObject << /X 5 0 R >>", objects=[form]), rng))
    return verdict(lambda: _looked_at(hpop.World.from_file(path, ratio=100)))


def ros_bag(rng: Rng, folder: Path) -> str:
    storage = ("ros1", "mcap", "sqlite3")[rng.integers(3)]
    cells = rng.choice([-1, 0, 50, 100], size=(12, 16))
    name = "walk.bag" if storage == "ros1" else "walk"
    path = plans.bag(folder / name, {"/map": [plans.grid(cells, storage=storage)]}, storage=storage)
    files = [path] if path.is_file() else sorted(path.iterdir())
    bent = files[rng.integers(len(files))]
    bent.write_bytes(bent_bytes(bent.read_bytes(), rng))
    topic = hostile(rng) if rng.random() < 0.2 else None
    with _read_here():
        return verdict(lambda: _looked_at(hpop.World.from_file(path, topic=topic)))


def _read_here() -> Any:
    """Half a second less for each; pdfium alone may bring down whoever reads."""
    return patch("hpop.world.reading_apart._said", lambda asked, data, path: child.said(asked, data))


# Robots

ARM = Path(__file__).resolve().parents[2] / "examples/arm"
MESH = '<mesh filename="hand.stl" scale="0.001 0.001 0.001"/>'
TETRAHEDRON = b"OFF\n4 4 0\n0 0 0\n90 0 0\n0 90 0\n0 0 90\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n"
ATTRIBUTE = re.compile(r'(?<==")[^"]*(?=")')


def arm(rng: Rng, folder: Path) -> str:
    """A URDF and an SRDF, bent in their bytes or attributes, and now and then a mesh: made, described, posed."""
    kind = ("stl", "obj", "ply", "off")[rng.integers(4)]
    for name in ("arm6.urdf", "arm6.srdf"):
        text = (ARM / name).read_text()
        if name.endswith("urdf"):
            text = text.replace('<box size="0.06 0.1 0.05"/>', MESH.replace("stl", kind))
        (folder / name).write_bytes(_bent_xml(text, rng))
    mesh = trimesh.load(io.BytesIO(TETRAHEDRON), file_type="off").export(file_type=kind)
    data = mesh if isinstance(mesh, bytes) else mesh.encode()
    (folder / f"hand.{kind}").write_bytes(bent_bytes(data, rng) if rng.random() < 0.3 else data)

    def made() -> None:
        found = hpop.SerialArm(folder / "arm6.urdf", "tool", 6.0, srdf=folder / "arm6.srdf")
        json.dumps(found.describe(), allow_nan=False)
        repr(found.pose("camera", found.space.sample(rng, 3)).x)

    return verdict(made)


def _bent_xml(text: str, rng: Rng) -> bytes:
    """XML as it is, with bent bytes, or with hostile values in the place of some attributes."""
    way = rng.random()
    if way < 0.2:
        return text.encode()
    if way < 0.6:
        return bent_bytes(text.encode(), rng)
    places = list(ATTRIBUTE.finditer(text))
    for place in sorted(rng.choice(len(places), int(rng.integers(1, 4)), replace=False), reverse=True):
        begin, end = places[place].span()
        value = str(hostile(rng)) if rng.random() < 0.7 else places[rng.integers(len(places))].group()
        text = text[:begin] + value.replace('"', "").replace("<", "").replace("&", "") + text[end:]
    return text.encode("utf-8", "surrogatepass")


# Scenarios


def scenario(rng: Rng, folder: Path) -> str:
    tree = ROOM | {"planner": PLANNERS[rng.integers(len(PLANNERS))]}
    if rng.random() < 0.3:
        tree["world"] = {"solids": SOLIDS}
    path = _written(folder / "room.yaml", tree, rng, _yaml)

    def read() -> None:
        loaded = load_scenario(path)
        description = json.loads(json.dumps(loaded.problem.describe(), allow_nan=False))
        repr(hpop.Problem.from_description(description))

    return verdict(read)


def plan(rng: Rng, folder: Path) -> str:
    """The command line from a scenario with hostile numbers to a front that `hpop show` accepts."""
    spec = PLANNERS[rng.integers(len(PLANNERS))]
    tree = ROOM | {"planner": spec}
    key = ("planner", "planner", "start", "goal", "model", "criteria")[rng.integers(6)]
    tree[key] = bent_tree(tree[key], rng, most=1)
    try:
        (folder / "room.yaml").write_text(_yaml(tree))
    except UnicodeEncodeError:
        return "refused"
    # Pictures take most of the time: one in eight is drawn.
    with nullcontext() if rng.random() < 0.125 else patch("hpop.cli.results.draw", return_value=[]):
        told = command(["plan", "room.yaml", "--out", "out"])
    if told == "accepted":
        front = hpop.Front.load(folder / "out" / "front.json")
        faults = verify(hpop.Problem.from_description(front.problem or {}), front)
        if faults:
            raise Wrong("a planned front that verify finds faults with")
    return told


def command(arguments: list[str]) -> str:
    """A command of hpop in this process; its output is clean, whatever was asked."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        result = CliRunner().invoke(main, arguments)
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    found = CONTROLS.search(result.output)
    if found:
        raise Wrong(f"the control character {found[0]!r} on the terminal")
    if "Traceback" in result.output:
        raise Wrong("a traceback on the terminal")
    return "accepted" if result.exit_code == 0 else "refused"


# Fronts

_FRONT: list[bytes] = []


def saved_front() -> bytes:
    """A small front of the room's, as it is saved; planned once."""
    if not _FRONT:
        world = hpop.World.from_solids(
            [
                Solid(Box((0.5, 0.5, 1.0)), pose_at((3.0, 2.0, 0.5), rpy=(0.1, 0.0, 0.0)), "case"),
                Solid(Hull(BLOCK["vertices"]), pose_at((5.5, 0.5, 0.0))),
                Solid(Cylinder(0.1, 1.0), pose_at((0.5, 3.0, 0.5))),
            ],
            extent=_box(0, 0, 6, 4),
        )
        problem = hpop.Problem(
            world, hpop.DifferentialDrive(), (1, 1, 0), (5, 3, None), ["obstruction", "turns", "length"]
        )
        path = Path("front.json")
        problem.solve("lattice", step=0.5).save(path)
        _FRONT.append(path.read_bytes())
        path.unlink()
    return _FRONT[0]


def _box(*corners: float) -> Any:
    import shapely

    return shapely.box(*corners)


def front(rng: Rng, folder: Path) -> str:
    path = folder / "front.json"
    if rng.random() < 0.3:
        path.write_bytes(bent_bytes(saved_front(), rng))
    else:
        path.write_bytes(_json(bent_tree(json.loads(saved_front()), rng)).encode("utf-8", "surrogatepass"))

    def read() -> None:
        loaded = hpop.Front.load(path)
        problem = hpop.Problem.from_description(loaded.problem or {})
        verify(problem, loaded)
        loaded.save(folder / "again.json")

    return verdict(read)


def show(rng: Rng, folder: Path) -> str:
    tree = bent_tree(json.loads(saved_front()), rng)
    (folder / "front.json").write_bytes(_json(tree).encode("utf-8", "surrogatepass"))
    return command(["show", str(folder)])


def pick(rng: Rng, folder: Path) -> str:
    """A choice from a bent front, by what may be no name and no number, and the table of what is picked."""
    tree = bent_tree(json.loads(saved_front()), rng) if rng.random() < 0.7 else json.loads(saved_front())
    (folder / "front.json").write_bytes(_json(tree).encode("utf-8", "surrogatepass"))
    named = [str(hostile(rng))[:200].replace("\0", "") if rng.random() < 0.3 else "length" for _ in range(2)]
    number = str(hostile(rng))[:200].replace("\0", "") if rng.random() < 0.3 else "9"
    way = (["--least", named[0]], ["--wish", f"{named[0]}={number}"], ["--row", number], ["--knee"])[rng.integers(4)]
    among = ["--at-most", f"{named[1]}={number}"] if rng.random() < 0.5 else []
    return command(["pick", str(folder), *way, *among, "--csv", str(folder / "camera.csv")])


# Checkpoints


def checkpoint(rng: Rng, folder: Path) -> str:
    """A checkpoint with an array bent and a right checksum: refused, or the search ends with the same front."""
    costs = int(rng.integers(2, 5))
    maker = np.random.default_rng(int(rng.integers(3)))
    tails, heads = maker.integers(0, 60, (2, 400))
    graph = Graph.from_arcs(60, tails, heads, maker.integers(1, 30, (400, costs)))
    method = ("auto", "general")[rng.integers(2)]
    path = folder / "search.ckpt"
    is_free = maker.random(400) < 0.8
    options: dict[str, Any] = {"method": method, "free": (None, is_free.__getitem__)[rng.integers(2)]}
    expected = pareto_paths(graph, 0, 59, **options)
    limit = Budget(max_labels=int(rng.integers(1, expected.stats.labels_generated)))
    begun = pareto_paths(graph, 0, 59, checkpoint=path, budget=limit, **options)
    if begun.status is Status.COMPLETE or not path.exists():
        return "accepted"
    path.write_bytes(_forged(path.read_bytes(), rng))
    found: list[Any] = []
    message = asked(lambda: found.append(pareto_paths(graph, 0, 59, checkpoint=path, **options)))
    if message:
        return shown(message)
    if not np.array_equal(np.unique(found[0].costs, axis=0), np.unique(expected.costs, axis=0)):
        # Labels can be left out unnoticed only by one who makes the evidence of them anew: two arrays that agree.
        raise Wrong("a forged checkpoint leads to another front")
    return "accepted"


def _forged(data: bytes, rng: Rng) -> bytes:
    """A checkpoint with one of its arrays changed in places, sealed again."""
    import hashlib

    length = int.from_bytes(data[len(MAGIC) : len(MAGIC) + LENGTH], "little")
    begin = len(MAGIC) + LENGTH + length
    header = json.loads(data[len(MAGIC) + LENGTH : begin])
    body = bytearray(data[begin:-CHECKSUM])
    tables = [(dtype, int(np.prod(shape))) for _, dtype, shape in header["arrays"]]
    chosen = int(rng.integers(len(tables)))
    at = sum(np.dtype(dtype).itemsize * count for dtype, count in tables[:chosen])
    dtype, count = np.dtype(tables[chosen][0]), tables[chosen][1]
    array = np.frombuffer(bytes(body[at : at + dtype.itemsize * count]), dtype).copy()
    if array.size:
        places = rng.integers(0, array.size, int(rng.integers(1, 4)))
        extremes = np.array([-1, 0, 1, 7, 2**15, 2**30, -(2**30)])
        with np.errstate(over="ignore"):
            array[places] = (rng.choice(extremes, places.size)).astype(dtype)
    body[at : at + dtype.itemsize * count] = array.tobytes()
    whole = data[:begin] + bytes(body)
    return whole + hashlib.blake2b(whole, digest_size=CHECKSUM).digest()


# The Python interface


GOOD: dict[str, Any] = {"urdf": str(ARM / "arm6.urdf"), "tip": "tool", "acceleration": 6.0, "target": (1.0, 0.5, 0.8)}
"""Values of parameters without a default."""


def python(rng: Rng, folder: Path) -> str:
    """Criteria, robots, planners and problems made of hostile parameters."""
    registry = (criteria, planners, models)[rng.integers(3)]
    cls = registry[list(registry)[rng.integers(len(registry))]]
    known = [field for field in dataclasses.fields(cls) if field.init]
    names = [field.name for field in known]
    chosen = rng.permutation(names)[: int(rng.integers(1, 3))]
    missing = dataclasses.MISSING
    needed = [field.name for field in known if field.default is missing and field.default_factory is missing]
    values = {name: GOOD[name] if name in GOOD else _argument(rng) for name in needed}
    values |= {str(name): _argument(rng) for name in chosen}
    return verdict(lambda: repr(cls(**values)))


def _argument(rng: Rng) -> Any:
    if rng.random() < 0.2:
        return [np.array([1.0, 2.0]), np.float64(0.5), np.int64(3), np.array(0.5), {1, 2}, b"x", object(), int][
            rng.integers(8)
        ]
    return hostile(rng)


def problem(rng: Rng, folder: Path) -> str:
    parts: dict[str, Any] = {
        "world": hpop.World.from_polygons([], extent=_box(0, 0, 6, 4)),
        "model": hpop.DifferentialDrive(),
        "start": (1, 1, 0),
        "goal": (5, 3, None),
        "criteria": ["obstruction", "turns", "length"],
    }
    for key in rng.permutation(list(parts))[: int(rng.integers(1, 3))]:
        whole = rng.random() < 0.3 or not isinstance(parts[str(key)], tuple | list)
        parts[str(key)] = _argument(rng) if whole else bent_tree(list(parts[str(key)]), rng)
    return verdict(lambda: hpop.Problem(**parts).solve("lattice", step=0.5))


def graph(rng: Rng, folder: Path) -> str:
    """Any arrays as a graph, any ends: the search on it ends, and nothing is read outside of them."""
    nodes, arcs = int(rng.integers(1, 12)), int(rng.integers(0, 30))
    tails, heads = rng.integers(-1 if rng.random() < 0.1 else 0, nodes + (rng.random() < 0.1), (2, arcs))
    costs: Any = rng.integers(0, 9, (arcs, int(rng.integers(1, 7))))
    if rng.random() < 0.3 and costs.size:
        extremes = [-1, 2**31, 2**62, 2**63 - 1, -(2**63)]
        costs.flat[rng.integers(costs.size)] = extremes[rng.integers(len(extremes))]
    if rng.random() < 0.2:
        costs = costs.astype(rng.choice([np.float64, np.float32, np.uint8, np.bool_, object]))
    options: dict[str, Any] = {}
    if rng.random() < 0.4:
        options[("eps", "tolerance", "at_most", "method")[rng.integers(4)]] = _argument(rng)
    ends = [int(rng.integers(-1, nodes + 1)) if rng.random() < 0.2 else int(rng.integers(nodes)) for _ in range(2)]
    made = _argument(rng) if rng.random() < 0.1 else nodes
    return verdict(lambda: pareto_paths(Graph.from_arcs(made, tails, heads, costs), *ends, **options))


# ROS


def ros(rng: Rng, folder: Path) -> str:
    """Goals as a bridge sends them, and paths as others plan them."""
    model = hpop.DifferentialDrive()
    if rng.random() < 0.3:
        tour = hpop.Trajectory.from_poses(model, [(1, 1, 0), (2, 1, 0)]).with_hold(at=0, seconds=1)
        path = bent_tree(path_message(tour, planned=True, timed=True), rng)
        return verdict(lambda: trajectory_of(path, model))
    goal = {"start": pose_message(1, 1, 0), "goal": pose_message(5, 3, 0), "planner_id": "knee", "use_start": True}
    told = {"op": "send_action_goal", "id": "1", "action": "/hpop/compute_path_to_pose", "args": goal}
    text = json.dumps(bent_tree(told, rng, most=1))
    data = bent_bytes(text.encode(), rng).decode(errors="replace") if rng.random() < 0.3 else text
    world = hpop.World.from_polygons([], extent=_box(0, 0, 6, 4))
    asked_first = hpop.Problem(world, model, (1, 1, 0), (5, 3, 0), ["turns", "length"])
    planning = Planning(asked_first, [planners["lattice"](step=0.5, time_limit=2.0)], Interface())
    answers = []

    def answer() -> None:
        message = protocol.parsed(data)
        protocol.goal_id(message)
        answers.append(planning.answer(message.get("args"), None))

    said = verdict(answer)
    return shown(answers[0].values["error_msg"]) if answers and answers[0].options is None else said


# The command line


def arguments(rng: Rng, folder: Path) -> str:
    """Commands with hostile arguments."""
    words = ["plan", "show", "pick", "check", "criteria", "planners", "--out", "out", "--workers", "--import"]
    words += ["--checkpoint", "--also", "--wish"]
    words += ["room.yaml", "--dask", "-h", "turns", "math:pi", "."]
    (folder / "room.yaml").write_text("world: {}\n")
    chosen = [str(words[rng.integers(len(words))]) for _ in range(int(rng.integers(1, 6)))]
    if rng.random() < 0.8:
        word = str(hostile(rng))[:5000].replace("\0", "").replace("\ud800", "\udc80")  # what a process can be given
        chosen[int(rng.integers(len(chosen)))] = word
    if "--dask" in chosen:  # would look for a scheduler
        return "refused"
    return command(chosen)


def warm(folder: Path) -> None:
    """Import and compile what inputs use, once, so that each process need not."""
    for number, spec in enumerate(PLANNERS):
        untimed = {name: {**options, "time_limit": None} for name, options in spec.items()}
        (folder / "room.yaml").write_text(_yaml(ROOM | {"planner": untimed}))
        if command(["plan", "room.yaml", "--out", f"out{number}"]) != "accepted":
            raise AssertionError(f"the scenario that is to be bent does not plan with {spec}")
    for costs in range(1, 7):
        for method in ("auto", "general"):
            maker = np.random.default_rng(costs)
            tails, heads = maker.integers(0, 60, (2, 400))
            pareto_paths(Graph.from_arcs(60, tails, heads, maker.integers(1, 3, (400, costs))), 0, 59, method=method)
    saved_front()


EVERY: list[Attempt] = [
    *(
        geojson,
        ros_map,
        movingai,
        tracks,
        moveit_scene,
        image,
        dxf,
        pdf,
        ros_bag,
        arm,
        scenario,
        plan,
        front,
        show,
        checkpoint,
    ),
    *(pick, python, problem, graph, ros, arguments),
]
TARGETS = {attempt.__name__: Target(attempt.__name__, attempt) for attempt in EVERY}
