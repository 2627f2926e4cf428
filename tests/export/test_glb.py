"""three's own loader and pygltflib open what is written as glTF: the camera is where it was, the world is as large."""

from __future__ import annotations

import json
import math
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pygltflib
import pytest
import shapely

import hpop
from hpop.export import write
from hpop.trajectories.trajectory import Trajectory
from hpop.view.ride import surfaces
from hpop.world.content.content import Person
from hpop.world.content.futures import Future
from hpop.world.tracks.track import Track
from tests.export.given import DRIVE, ODD, POSES, problem, robots, through
from tests.export.readers import GLTF, accessor

THREE = Path(__file__).resolve().parents[2] / "web/node_modules/three"


def loaded(path, times):
    """Return a file as three.js reads it."""
    node = shutil.which("node")
    if node is None or not THREE.is_dir():
        pytest.skip("no node, or no modules in web/: npm ci")
    script = Path(__file__).with_name("read_glb.mjs")
    asked = json.dumps(times.tolist())
    done = subprocess.run([node, script, THREE, path, asked], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_three_finds_the_camera_where_it_was_and_looking_where_it_looked(tmp_path):
    seen = hpop.PanTilt(field_of_view=(math.radians(100), math.radians(70)))
    trajectory = through(seen, (1, 1, 0, 0, 0), (2, 1, 1, 1, 0.3), (2, 1, 1, -2, -0.4))
    run = trajectory.execution()
    times = np.linspace(0.0, run.duration, 25)
    path = write(trajectory, tmp_path / "any.glb", rate=60, problem=problem())
    found = loaded(path, times)
    assert found["duration"] == pytest.approx(run.duration, rel=1e-6)
    pose = seen.pose("camera", run.at(times))
    for name, vector in (("position", (pose.x, pose.y, pose.z)), ("ahead", pose.ahead), ("up", pose.up)):
        asked = np.stack(np.broadcast_arrays(*vector, times)[:3], axis=1) @ GLTF.T
        np.testing.assert_allclose([one[name] for one in found["seen"]], asked, atol=2e-3)  # between keys it is linear
    assert found["fov"] == pytest.approx(70.0)
    assert found["aspect"] == pytest.approx(math.tan(math.radians(50)) / math.tan(math.radians(35)))
    walked = [(one["people"][0], t) for one, t in zip(found["seen"], times.tolist(), strict=True)]
    stops = problem().world.content.people[0].until  # before the wall
    assert 0 < stops < run.duration
    for (x, y, z), t in walked:
        assert (x, y, z) == pytest.approx((-0.5 * min(t, stops), 0.0, -0.25 * min(t, stops)), abs=1e-5)
    boxes = {mesh["name"]: (mesh["low"], mesh["high"]) for mesh in found["meshes"]}
    low, high = boxes["wall"]
    assert (low, high) == (pytest.approx([0, 0, -6]), pytest.approx([8, 3, 0]))
    table = next(box for name, box in boxes.items() if name.startswith("</script>"))
    assert table == (pytest.approx([5, 0.7, -3]), pytest.approx([6, 0.75, -2]))


@pytest.mark.parametrize("robot", ["differential drive", "stays"])
def test_the_file_is_what_the_standard_asks_for(robot, tmp_path):
    path = write(robots()[robot], tmp_path / "any.glb", problem=problem())
    file = pygltflib.GLTF2().load(path)
    assert file.asset.version == "2.0"
    assert path.stat().st_size % 4 == 0
    for view in file.bufferViews:
        assert view.byteOffset % 4 == 0
        assert view.byteOffset + view.byteLength <= file.buffers[0].byteLength
    for one in file.animations[0].samplers:
        times = accessor(file, one.input)
        assert (np.diff(times.ravel()) > 0).all()
        assert file.accessors[one.input].min == times.min(axis=0).tolist()
        assert file.accessors[one.input].max == times.max(axis=0).tolist()
        assert len(accessor(file, one.output)) == len(times)
    targets = [(channel.target.node, channel.target.path) for channel in file.animations[0].channels]
    assert len(set(targets)) == len(targets)
    for mesh in file.meshes:
        (primitive,) = mesh.primitives
        corners = accessor(file, primitive.attributes.POSITION)
        normals = accessor(file, primitive.attributes.NORMAL)
        assert file.accessors[primitive.attributes.POSITION].min == corners.min(axis=0).tolist()
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-6)
        faces = corners.reshape(-1, 3, 3)
        across = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
        assert (np.einsum("ti,ti->t", across, normals[::3]) > 0).all()  # counter-clockwise seen from outside
    names = [node.name for node in file.nodes]
    assert names[0] == "camera_link"
    assert not any(letter in name for name in names for letter in "\n\x1b\u202e")


def test_a_trajectory_alone_is_a_camera_without_a_world(tmp_path):
    file = pygltflib.GLTF2().load(write(robots()["pan-tilt"], tmp_path / "any.glb"))
    assert len(file.nodes) == 1
    assert not file.meshes
    assert file.cameras[0].perspective.yfov == pytest.approx(math.radians(60))


def test_a_view_wider_than_a_picture_can_be_is_cut(tmp_path):
    wide = hpop.PanTilt(field_of_view=(math.radians(300), math.radians(90)))
    camera = pygltflib.GLTF2().load(write(through(wide, (1, 1, 0, 0, 0)), tmp_path / "any.glb")).cameras[0]
    assert camera.perspective.yfov == pytest.approx(math.radians(90))
    assert camera.perspective.aspectRatio == pytest.approx(math.tan(math.radians(85)))


@pytest.mark.proof
def test_times_that_one_float32_cannot_tell_apart_are_kept_once(tmp_path):
    """Only the last two of very many times can coincide: 50 ns before the end, a float32 equals the end."""
    stays = Trajectory.from_poses(DRIVE, POSES[:1]).with_hold(at=0, seconds=1.000000055)
    file = pygltflib.GLTF2().load(write(stays, tmp_path / "any.glb", rate=2e5))
    times = accessor(file, file.animations[0].samplers[0].input).ravel()
    assert times.size == 200_001  # of 200,002
    assert (np.diff(times) > 0).all()
    assert times[-1] == np.float32(stays.duration)


def test_colours_are_linear_light(tmp_path):
    file = pygltflib.GLTF2().load(write(robots()["stays"], tmp_path / "any.glb", problem=problem()))
    named = {node.name: file.meshes[node.mesh].primitives[0].material for node in file.nodes if node.mesh is not None}
    for name, colour in (("wall", surfaces.WALL), ("floor", surfaces.FLOOR)):
        light = np.array(file.materials[named[name]].pbrMetallicRoughness.baseColorFactor)
        assert light[3] == 1.0
        shown = 255.0 * (1.055 * light[:3] ** (1 / 2.4) - 0.055)  # IEC 61966-2-1
        np.testing.assert_allclose(shown, colour, atol=0.01)


def test_costs_and_what_is_not_drawn_as_it_is_are_in_the_file(tmp_path):
    path = write(robots()["stays"], tmp_path / "any.glb", problem=problem())
    extras = pygltflib.GLTF2().load(path).asset.extras
    assert "obstacles without an upper end are drawn 3 m high" in extras["notes"]
    assert ODD.encode() not in path.read_bytes()


def walks(path):
    """Return each person's positions at some times, and visibility, by pygltflib and linear keys."""
    file = pygltflib.GLTF2().load(path)
    found = {}
    for i, node in enumerate(file.nodes):
        if node.name.startswith("person") and not node.name.endswith((" 1", " 2")):  # legs; trunk and head go along
            corners = accessor(file, file.meshes[node.mesh].primitives[0].attributes.POSITION) @ GLTF
            found[node.name] = {"begins": 0.5 * (corners.min(axis=0) + corners.max(axis=0))[:2]}
            for channel in file.animations[0].channels:
                if channel.target.node == i:
                    sampler = file.animations[0].samplers[channel.sampler]
                    times, values = accessor(file, sampler.input).ravel(), accessor(file, sampler.output)
                    assert sampler.interpolation == {"translation": "LINEAR", "scale": "STEP"}[channel.target.path]
                    found[node.name][channel.target.path] = (times, values)
    return found


def place(walk, t):
    times, moved = walk.get("translation", (np.zeros(1), np.zeros((1, 3))))
    return walk["begins"] + [np.interp(t, times, column) for column in (moved @ GLTF).T[:2]]


def is_there(walk, t):
    times, sizes = walk.get("scale", (np.zeros(1), np.ones((1, 3))))
    return bool(sizes[np.searchsorted(times, t, side="right") - 1].all())


def test_people_are_where_they_are_predicted_at_each_time(tmp_path):
    """Tracks, futures, an end at a wall, who is gone; the robot holds meanwhile, so that times are not its plan's."""
    turns = Track.through([(0, 2, 5), (1.7, 3, 5), (4, 3, 3)])
    late = Track(np.array([1.3, 3.1]), np.array([6.0, 7.0]), np.array([1.0, 1.0]), recorded=True)
    people = [
        Person(1, 5, velocity=(0.5, 0), name="walks"),
        Person(2, 2, velocity=(0.25, 0.5), until=2.1, afterwards="stays", name="stops"),
        Person.along(turns, name="turns"),
        Person.along(late, name="late"),
        Person(4, 4, futures=(Future(3, (0, 0.1)), Future(1, (0.1, 0))), name="doubts"),
        Person(7, 5, name="stands"),
    ]
    room = hpop.World.from_polygons([], extent=shapely.box(0, 0, 8, 6)).with_content(people=people)
    asked = hpop.Problem(room, DRIVE, POSES[0], POSES[-1], ["length"])
    held = Trajectory.from_poses(DRIVE, POSES).with_hold(at=1, seconds=2.5)
    found = walks(write(held, tmp_path / "any.glb", problem=asked))
    assert set(found) == {f"person {name}" for name in ("walks", "stops", "turns", "late", "stands")} | {
        "person doubts (75%)", "person doubts (25%)",
    }  # fmt: skip
    lasts = held.execution().duration
    for person in asked.world.content.people:
        for weight, one in person.hypotheses:
            walk = found[f"person {person.name}" + (f" ({weight:.0%})" if person.futures else "")]
            for t in np.linspace(0, lasts, 40) + 1e-4:
                assert is_there(walk, t) == bool(one.there(t))
                if is_there(walk, t):
                    np.testing.assert_allclose(place(walk, t), one.at(t), atol=1e-4)
    assert found["person stands"].keys() == {"begins"}
    assert "scale" not in found["person stops"]
