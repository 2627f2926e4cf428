"""Readers of maps, drawings, scenes and tracks."""

from __future__ import annotations

import io
import json
import re
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import shapely
from mutations import Rng, bent_bytes, hostile
from PIL import Image
from verdicts import asked, verdict

import hpop
from hpop.apart import child
from hpop.world import Person
from hpop.world.content.predictions import bounded
from targets.given import BLOCK, as_json, as_yaml, written
from tests import worlds

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
        {
            "type": "Feature",
            "properties": {"indoor": "room", "level": "0;1", "height": "12 ft"},
            "geometry": {"type": "Polygon", "coordinates": [[[9, 0, 1], [12, 0], [12, 7], [9, 7]]]},
        },
        {"type": "Feature", "properties": {"door": "yes"}, "geometry": {"type": "Point", "coordinates": [9, 4]}},
        {"type": "Feature", "properties": {"landmark": True}, "geometry": {"type": "Point", "coordinates": [4, 4]}},
        {"type": "Feature", "properties": None, "geometry": {"type": "LineString", "coordinates": [[1, 1], [5, 5]]}},
    ],
}
CRS: list[dict[str, Any]] = [
    {},
    {"crs": {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::3857"}}},
    {"crs": {"type": "name", "properties": {"name": "urn:ogc:def:crs:OGC:1.3:CRS84"}}},
]
ROS_MAP = {
    "image": "map.pgm",
    "resolution": 0.1,
    "origin": [-1.0, -2.0, 0.0],
    "negate": 0,
    "occupied_thresh": 0.65,
    "free_thresh": 0.196,
    "mode": "trinary",
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


def _looked_at(world: hpop.World) -> None:
    """Use a world as every caller does first."""
    x0, y0, x1, y1 = world.bounds
    world.clearance(np.linspace(x0, x1, 5), np.linspace(y0, y1, 5))
    json.dumps(world.describe(), allow_nan=False)
    repr(world)
    asked(lambda: world.bodies)


def as_lines(tree: Any) -> str:
    """Features one a line, with record separators now and then."""
    features = tree.get("features") if isinstance(tree, dict) else None
    several = features if isinstance(features, list) else [tree]
    return "".join(("\x1e" * (i % 2)) + as_json(each) + "\n" for i, each in enumerate(several))


def geojson(rng: Rng, folder: Path) -> str:
    dump = as_lines if rng.random() < 0.2 else as_json
    path = written(folder / "plan.geojson", GEOJSON | CRS[rng.integers(len(CRS))], rng, dump)
    meaning = ("obstacles", "free", "outline", "rooms")[rng.integers(4)]
    named = ("units", "wall_width", "origin", "crs", "where")
    options = {named[rng.integers(len(named))]: hostile(rng)} if rng.random() < 0.3 else {}
    wide = {"wall_width": 0.1, **options}
    return verdict(lambda: _looked_at(hpop.World.from_geojson(path, polygons=meaning, **wide)))  # type: ignore[arg-type]


def ros_map(rng: Rng, folder: Path) -> str:
    pixels = rng.choice([0, 205, 254], size=(20, 30)).astype(np.uint8)
    picture = b"P5\n# map\n30 20\n255\n" + pixels.tobytes()
    (folder / "map.pgm").write_bytes(bent_bytes(picture, rng) if rng.random() < 0.5 else picture)
    said = ROS_MAP | {"mode": ("trinary", "scale", "raw")[rng.integers(3)]}
    said |= {"image": ("map.pgm", "/home/ada/map.pgm", "MAP", "gone.png")[rng.integers(4)]}
    path = written(folder / "map.yaml", said, rng, as_yaml)
    keep_out = path if rng.random() < 0.3 else None
    return verdict(lambda: _looked_at(hpop.World.from_ros_map(path, keep_out=keep_out)))


def movingai(rng: Rng, folder: Path) -> str:
    rows = "\n".join("".join(row) for row in rng.choice(list(".@GTW"), size=(12, 16)))
    path = folder / "grid.map"
    path.write_bytes(bent_bytes(f"type octile\nheight 12\nwidth 16\nmap\n{rows}\n".encode(), rng))
    return verdict(lambda: _looked_at(hpop.World.from_movingai(path)))


LANE = (
    '<lanelet id="{}"><leftBound><point><x>0</x><y>{}</y></point><point><x>9</x><y>{}</y></point></leftBound>'
    "<rightBound><point><x>0</x><y>{}</y></point><point><x>9</x><y>{}</y></point></rightBound>{}</lanelet>"
)
STATE = (
    "<{0}><position><point><x>{1}</x><y>1.5</y></point></position><orientation><exact>0.1</exact></orientation>"
    "<time><exact>{2}</exact></time></{0}>"
)
BOX = "<shape><rectangle><length>2.5</length><width>1.1</width></rectangle></shape>"
ROAD = (
    '<?xml version="1.0"?><commonRoad commonRoadVersion="2020a" timeStepSize="0.1">'
    + LANE.format(1, 3, 3, 0, 0, '<trafficSignRef ref="7"/><laneletType>urban</laneletType>')
    + LANE.format(2, 6, 6, 3, 3, "<userBidirectional>vehicle</userBidirectional><speedLimit>8</speedLimit>")
    + '<trafficSign id="7"><trafficSignElement><trafficSignID>274</trafficSignID>'
    "<additionalValue>13.9</additionalValue></trafficSignElement></trafficSign>"
    + f'<staticObstacle id="3"><type>parkedVehicle</type>{BOX}{STATE.format("initialState", 7, 0)}</staticObstacle>'
    + f'<dynamicObstacle id="4"><type>car</type>{BOX}{STATE.format("initialState", 2, 0)}<trajectory>'
    + "".join(STATE.format("state", 2 + step, step) for step in range(1, 4))
    + f'</trajectory></dynamicObstacle><planningProblem id="5">{STATE.format("initialState", 1, 0)}<goalState>'
    "<position><rectangle><length>2</length><width>2</width><orientation>0</orientation><center><x>8</x><y>1.5</y>"
    "</center></rectangle></position><orientation><intervalStart>-0.2</intervalStart><intervalEnd>0.2</intervalEnd>"
    "</orientation><time><intervalStart>1</intervalStart><intervalEnd>9</intervalEnd></time></goalState>"
    "</planningProblem></commonRoad>"
)


def road(rng: Rng, folder: Path) -> str:
    """Read a road of CommonRoad with bent bytes or hostile numbers, and its planning problem."""
    text = ROAD
    for _ in range(int(rng.integers(0, 3))):
        numbers = [*re.finditer(r"(?<=>)-?[\d.]+(?=<)", text)]
        one = numbers[rng.integers(len(numbers))]
        value = hostile(rng) if rng.random() < 0.3 else round(float(rng.normal(0.0, 4.0)), 2)
        text = f"{text[: one.start()]}{value}{text[one.end() :]}"
    data = text.encode(errors="surrogatepass")
    path = folder / "road.xml"
    path.write_bytes(bent_bytes(data, rng) if rng.random() < 0.3 else data)
    options = {("height", "traffic")[rng.integers(2)]: hostile(rng)} if rng.random() < 0.2 else {}

    def read() -> None:
        _looked_at(hpop.World.from_file(path, **options))
        hpop.world.planning_problem(path, **({"number": hostile(rng)} if rng.random() < 0.2 else {}))

    return verdict(read)


TRACKS = (
    "# framerate: 25 fps\n# id frame x/cm y/cm z/cm\n"
    + "".join(f"{i % 3} {i} {10 * i} 150.5 176\n" for i in range(30)),
    "id,t,x [mm],y [mm]\n" + "".join(f"{'Ada' if i % 2 else 7},{0.1 * i:.1f},{40 * i},1500\n" for i in range(30)),
    "".join(f"{6.0 * i:.7e} {1.0 + i % 3} {0.5 * i} 0.0 3.5 1.2 0.0 0.1\n" for i in range(30)),
    "".join(f"{10 * (i // 3)}\t{i % 3}\t{0.05 * i}\t{i % 3}\n" for i in range(30)),
    "id;time/ms;x;y\n"
    + "".join(f"{i % 2};{1700000000000 + 100 * i};{4 * i // 100},{4 * i % 100:02};1,5\n" for i in range(30)),
    "id time x y\n" + "".join(f"A 2023-11-14T12:00:{i:02} {0.5 * i} 1\n" for i in range(30)),
    "#framerate: 8\n#ID FR X Y Z A\n" + "".join(f"{i % 2} {i} {0.1 * i} 3 0 .3\n" for i in range(30)),
)


def _jupedsim() -> bytes:
    with closing(sqlite3.connect(":memory:")) as base:
        base.execute("CREATE TABLE trajectory_data (frame INTEGER, id INTEGER, pos_x REAL, pos_y REAL)")
        base.execute("CREATE TABLE metadata (key TEXT, value TEXT)")
        base.execute("INSERT INTO metadata VALUES ('fps', '8')")
        base.executemany("INSERT INTO trajectory_data VALUES (?, ?, ?, 1)", [(i, i % 2, 0.1 * i) for i in range(30)])
        base.commit()
        return base.serialize()


def tracks(rng: Rng, folder: Path) -> str:
    path = folder / "people.txt"
    some = [*(text.encode() for text in TRACKS), _jupedsim()]
    path.write_bytes(bent_bytes(some[rng.integers(len(some))], rng))
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
    path = written(folder / "scene.yaml", SCENE, rng, as_yaml)
    if rng.random() < 0.3:  # a change after it, as ROS 2 prints one after the other
        first = path.read_bytes()
        path.write_bytes(first + b"\n---\n" + written(path, SCENE | {"is_diff": True}, rng, as_yaml).read_bytes())
    return verdict(lambda: _looked_at(hpop.World.from_moveit_scene(path)))


SCENE_TEXT = b"(noname)\n* ball\n0 0 1\n0 0 0 1\n1\nsphere\n0.2\n0 0 0\n0 0 0 1\n0 0 0 0\n0\n.\n"
CLOUDS = {
    "ply": b"ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n"
    b"end_header\n0 0 1\n2 0 1\n",
    "pcd": b"VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2\nHEIGHT 1\nPOINTS 2\nDATA binary\n"
    + np.array([[0, 0, 1], [2, 0, 1]], "<f4").tobytes(),
}


def points_and_texts(rng: Rng, folder: Path) -> str:
    """Read a point cloud or a scene as text, with bent bytes."""
    kind = ("scene", *CLOUDS)[rng.integers(3)]
    path = folder / f"plan.{kind}"
    path.write_bytes(bent_bytes(SCENE_TEXT if kind == "scene" else CLOUDS[kind], rng))
    options = {} if kind == "scene" else {"resolution": float(rng.choice([0.01, 0.5]))}
    return verdict(lambda: _looked_at(hpop.World.from_file(path, **options)))


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
    """Read a drawing with bent bytes, or hostile options; in this process, where memory and time are bounded too."""
    path = folder / "plan.dxf"
    path.write_bytes(bent_bytes(worlds.dxf(_drawn), rng))
    named = ("scale", "layers", "wall_width", "inside", "door_arcs")
    options = {named[rng.integers(len(named))]: hostile(rng)} if rng.random() < 0.3 else {}
    asked_for: dict[str, Any] = {"door_arcs": ("closed", "open")[rng.integers(2)], **options}
    with _read_here():
        return verdict(lambda: _looked_at(hpop.World.from_file(path, **asked_for)))


def _drawn(drawing: Any) -> None:
    space = drawing.modelspace()
    space.add_lwpolyline([(0, 0, 0.3), (6, 0, 0), (6, 4, 0), (0, 4, -1)], format="xyb", close=True)
    space.add_circle((3, 2), 0.5, dxfattribs={"layer": "COLUMNS"})
    space.add_arc((1, 0), 0.9, 0, 90)
    space.add_line((0, 0), (6, 4), dxfattribs={"invisible": 1})
    space.add_lwpolyline([(0, 1, 0.2, 0.1, 0.5), (2, 1, 0.1, 0.1, 0), (2, 3, 0, 0, 0)], format="xyseb")
    space.add_mline([(0, 2), (3, 2), (3, 3)], dxfattribs={"scale_factor": 0.2})
    space.add_spline([(1, 1), (2, 2), (3, 1)])
    space.add_hatch().paths.add_polyline_path([(4, 1), (5, 1), (5, 2)], is_closed=True)
    drawing.blocks.new("TABLE").add_ellipse((0, 0), (0.4, 0), 0.5)
    space.add_blockref("TABLE", (1, 3), dxfattribs={"rotation": 30, "column_count": 2, "column_spacing": 1})


def pdf(rng: Rng, folder: Path) -> str:
    """Read a page with bent bytes, in the child process that contains crashes of pdfium."""
    form = worlds.stream(b"0 0 m 9 0 l 9 9 9 9 0 9 c S", b"/Type /XObject /Subtype /Form /BBox [0 0 99 99]")
    content = b"1 w 50 50 m 350 50 l 350 250 l 50 250 l s q 2 0 0 2 90 90 cm /X Do Q 0.2 g 100 200 30 30 re f"
    content += b" q 60 60 m 200 60 l 60 200 l h W n 5 w 0 100 m 500 100 l S 60 60 90 90 re f Q"
    path = folder / "plan.pdf"
    path.write_bytes(
        bent_bytes(worlds.pdf(content, page=b"/UserUnit 2", resources=b"/XObject << /X 5 0 R >>", objects=[form]), rng)
    )
    return verdict(lambda: _looked_at(hpop.World.from_file(path, ratio=100)))


def ros_bag(rng: Rng, folder: Path) -> str:
    storage = ("ros1", "mcap", "sqlite3")[rng.integers(3)]
    cells = rng.choice([-1, 0, 50, 100], size=(12, 16))
    name = "walk.bag" if storage == "ros1" else "walk"
    path = worlds.bag(folder / name, {"/map": [worlds.grid(cells, storage=storage)]}, storage=storage)
    files = [path] if path.is_file() else sorted(path.iterdir())
    bent = files[rng.integers(len(files))]
    bent.write_bytes(bent_bytes(bent.read_bytes(), rng))
    topic = hostile(rng) if rng.random() < 0.2 else None
    with _read_here():
        return verdict(lambda: _looked_at(hpop.World.from_file(path, topic=topic)))


def _read_here() -> Any:
    """Half a second less for each; pdfium alone may bring down whoever reads."""
    return patch("hpop.world.files._child_output", lambda asked, data, path: child.answer_bytes(asked, data))
