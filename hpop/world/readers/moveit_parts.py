"""Parts of planning scenes: checked values with their location in words, rules for links, and MoveIt's text format.

Rules are ``link_padding``, ``link_scale`` and ``allowed_collision_matrix``, and the objects that the state of the robot
attaches to links, ``attached_collision_objects``. A ``.scene`` file is the text that MoveIt's
panel "Scene Objects" exports. Its first line is the name of the scene. An object is ``* NAME``, its position, its
quaternion, the number of its shapes, the shapes, the number of its subframes, and the subframes. Files of before 2020
have neither the pose nor the subframes. A shape is its type, its sizes, its position, its quaternion, and its colour.
The last line is a full stop.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import replace
from typing import Any, NamedTuple

from hpop.base.arrays import FloatArray
from hpop.base.options import MOST, real
from hpop.base.text import counted, shown
from hpop.errors import MapError
from hpop.world.bodies import MOST_ATTACHED, LinkRules, Pair, padding_of, scale_of
from hpop.world.geometry.solids import MOST_POINTS, MOST_SOLIDS, Shape, Solid, rpy_of

CUT = "..."
"""Text that ``ros2 topic echo`` writes in place of omitted values."""
NO_ARRAY = ("<sequence type:", "<array type:")


class SceneEntry(NamedTuple):
    """Value in a scene file (``given``), with its location in words (``what``) for messages."""

    what: str
    given: Any

    def fault(self, expected: str) -> MapError:
        """Return an error that states the location, the expected value and the actual value."""
        return MapError(f"{self.what} must be {expected}; got {shown(self.given)}.")

    def get(self, key: str) -> SceneEntry:
        """Return the entry under a key of a mapping; the value of the entry is None if the key is missing."""
        if not isinstance(self.given, dict):
            raise self.fault("a yaml mapping")
        return SceneEntry(f"{self.what}: {key}", self.given.get(key))

    def entries(self, most: int = MOST_SOLIDS) -> list[SceneEntry]:
        """Return the entries of a list; an empty list for a missing one."""
        given = [] if self.given is None else self.given
        if isinstance(given, str) and given.startswith(NO_ARRAY):
            raise MapError(f"{self.what} is left out, as ros2 topic echo --no-arr does; print it without that option.")
        if given == CUT or (isinstance(given, list) and CUT in given):
            raise MapError(
                f"{self.what} is cut short (...), as ros2 topic echo does; print all: ros2 topic echo --full-length."
            )
        if not isinstance(given, list):
            raise self.fault("a list")
        if len(given) > most:
            raise MapError(f"{self.what} has {len(given):,} entries; at most {most:,} are read. Leave some out.")
        return [SceneEntry(f"{self.what} {place}", entry) for place, entry in enumerate(given)]

    def numbers(self, keys: str) -> tuple[float, ...]:
        """Return a number for each letter of ``keys``, such as "xyz", from a list or a mapping with these keys."""
        given = self.given
        if isinstance(given, dict) and given.keys() == set(keys):
            given = [given[key] for key in keys]
        if not isinstance(given, list) or len(given) != len(keys):
            raise self.fault(f"[{', '.join(keys)}]")
        return tuple(float(real(self.what, value, -MOST, MOST, error=MapError)) for value in given)

    def name(self, what: str) -> str:
        """Return the value of the entry, a name; MapError unless it is a text that is not empty.

        ``what`` is the named thing, for the message, such as "a link".
        """
        if not isinstance(self.given, str) or not self.given:
            raise self.fault(f"the name of {what}")
        return self.given


MOST_NAMES = 1_000
"""Largest number of names in an allowed collision matrix, and of links that are padded or scaled."""
OCTOMAP = "<octomap>"
"""Name of the octomap in a matrix; scenes with an octomap are not read."""


def link_rules(scene: SceneEntry, before: LinkRules) -> LinkRules:
    """Return the rules of a message, given those of the messages ``before``, as MoveIt applies them.

    Padding and scale of links that the message names are replaced. The message's collision matrix replaces the matrix
    before, unless the new one is empty.
    """
    pairs, others = _matrix(scene.get("allowed_collision_matrix"))
    if not pairs and not others:
        pairs, others = dict(before.pairs), dict(before.others)
    padding = _numbers(scene.get("link_padding"), "padding", padding_of)
    scale = _numbers(scene.get("link_scale"), "scale", scale_of)
    return LinkRules({**before.padding, **padding}, {**before.scale, **scale}, pairs, others, before.attached)


def attached_objects(
    state: SceneEntry,
    before: LinkRules,
    objects: Collection[str],
    shapes: Callable[[SceneEntry], Iterable[tuple[Shape, FloatArray]]],
) -> LinkRules:
    """Return rules with the objects that a state of the robot attaches to links, added to those ``before``.

    An object of several shapes becomes several objects, with numbers after its name.

    objects  names of obstacles
    shapes   function that yields each shape of a collision object, with its pose (4, 4) in the frame of its header

    MapError for an object that is not given by shapes in the frame of its link, and for one that is to be detached.
    """
    found, pairs, others = {str(each["name"]): each for each in before.attached}, {**before.pairs}, {**before.others}
    listed = state.get("attached_collision_objects") if isinstance(state.given, dict) else SceneEntry("", None)
    for entry in listed.entries(MOST_ATTACHED):
        link, thing = entry.get("link_name").name("a link"), entry.get("object")
        name = thing.get("id").name("an object")
        header, operation = thing.get("header"), thing.get("operation")
        frame = None if header.given is None else header.get("frame_id").given
        if name in objects:
            raise MapError(
                f"{thing.what}: {shown(name)} is attached to the link {shown(link)}, and is a collision object of the "
                "world as well. Remove it from one of them."
            )
        if operation.given not in (None, 0, "\0", "add", "ADD"):
            raise operation.fault("0 (add): to change what a robot holds, save the whole scene after the change")
        if str(frame or link).lstrip("/") != link:
            raise header.fault(f"the frame of the link that carries the object, {shown(link)}")
        touches = [part.name("a link") for part in entry.get("touch_links").entries(MOST_NAMES)]
        placed = list(shapes(thing))
        if not placed:
            raise thing.fault("an attached object with its shapes: primitives or meshes")
        for number, (shape, pose) in enumerate(placed, 1):
            solid = Solid(shape, pose, name if len(placed) == 1 else f"{name} {number}")
            given = solid.describe()
            del given["pose"]
            place = {"position": pose[:3, 3].tolist(), "rpy": rpy_of(pose).tolist()}
            found[solid.name] = {**given, "link": link, **place, "touches": touches}
            of_part = {pair: may for pair, may in before.pairs.items() if name in pair}
            pairs |= {_pair(solid.name, a if b == name else b): may for (a, b), may in of_part.items()}
            others |= {solid.name: before.others[name]} if name in before.others else {}
    return replace(before, pairs=pairs, others=others, attached=tuple(found.values()))


def rule_notes(scene: SceneEntry, rules: LinkRules, objects: Collection[str]) -> Iterator[str]:
    """Yield notes for the user on rules that change what an arm may do; ``objects`` are names of obstacles."""
    padded = [by for by in rules.padding.values() if by]
    scaled = [by for by in rules.scale.values() if by != 1.0]
    if padded:
        yield (
            f"{scene.what} pads {counted(len(padded), 'link')} by up to {max(padded):g} m (link_padding): an arm with "
            "links of these names keeps this distance from obstacles"
        )
    if scaled:
        yield (
            f"{scene.what} scales {counted(len(scaled), 'link')} by {min(scaled):g} to {max(scaled):g} (link_scale): "
            "links of these names are tested with obstacles at this size"
        )
    if rules.attached:
        held = ", ".join(f"{each['name']!r} on {each['link']!r}" for each in rules.attached[:8])
        yield f"{scene.what} attaches objects to links, which an arm with these links holds: {held}"
    free = sorted({name for pair, may in rules.pairs.items() if may for name in pair if name in objects})
    free = sorted({*free, *(name for name, may in rules.others.items() if may and name in objects)})
    if free:
        listed = ", ".join(map(repr, free[:8])) + (", ..." if len(free) > 8 else "")
        yield (
            f"{scene.what} lets links touch obstacles, which are not tested with these links "
            f"(allowed_collision_matrix): {listed}"
        )


def _numbers(listed: SceneEntry, key: str, checked: Callable[[str, Any], float]) -> dict[str, float]:
    """Return the number of each link in ``link_padding`` or ``link_scale``."""
    return {
        part.get("link_name").name("a link"): checked(part.get(key).what, part.get(key).given)
        for part in listed.entries(MOST_NAMES)
    }


def _matrix(matrix: SceneEntry) -> tuple[dict[Pair, bool], dict[str, bool]]:
    """Return the entries of a matrix by pairs of names, and its default entries by name."""
    if matrix.given is None:
        return {}, {}
    names = [part.name("a link or an object") for part in matrix.get("entry_names").entries(MOST_NAMES)]
    rows = [_flags(row) for row in matrix.get("entry_values").entries(MOST_NAMES)]
    if [len(row) for row in rows] != [len(names)] * len(names):
        raise MapError(
            f"{matrix.what} must have a row of entry_values for each of its {len(names)} entry_names, with as many "
            f"values; got {len(rows)} rows of {', '.join(map(str, sorted({len(row) for row in rows})))} values."
        )
    pairs = {
        _pair(one, other): rows[i][j] and rows[j][i]
        for i, one in enumerate(names)
        for j, other in enumerate(names[:i])
        if OCTOMAP not in (one, other)
    }
    known = [part.name("a link or an object") for part in matrix.get("default_entry_names").entries(MOST_NAMES)]
    values = _flags(matrix.get("default_entry_values"))
    if len(known) != len(values):
        raise MapError(
            f"{matrix.what} must have one of default_entry_values for each of default_entry_names; got {len(known)} "
            f"names and {len(values)} values."
        )
    return pairs, {name: value for name, value in zip(known, values, strict=True) if name != OCTOMAP}


def _pair(one: str, other: str) -> Pair:
    return (one, other) if one < other else (other, one)


def _flags(row: SceneEntry) -> list[bool]:
    """Return a row of true and false, given as a list or as a mapping with the key "enabled"."""
    entries = (row.get("enabled") if isinstance(row.given, dict) else row).entries(MOST_NAMES)
    for part in entries:
        if part.given not in (True, False):
            raise part.fault("true or false")
    return [bool(part.given) for part in entries]


SIZES = {"box": 3, "sphere": 1, "cylinder": 2, "cone": 2}
"""Number of sizes of a shape: x, y, z; radius; radius and length."""
MOST_SUBFRAMES = 1_000
OBJECT = re.compile(r"^\*[^\S\n]", re.MULTILINE)
WORD = re.compile(r"\S+")


def is_scene_text(text: str) -> bool:
    """Return whether a text is in MoveIt's text format, not YAML: a line begins with an asterisk and a space."""
    return OBJECT.search(text) is not None


def scene_of_text(text: str, what: str) -> dict[str, Any]:
    """Return the scene as the mapping that a YAML scene has; MapError, with the name ``what``, if it is malformed."""
    return _SceneText(text, what).scene()


class _SceneText:
    """Text of a scene, read word by word."""

    def __init__(self, text: str, what: str) -> None:
        self.text, self.what = text, what
        self.place = text.find("\n") + 1
        begin = OBJECT.search(text)
        first = text[begin.start() :].split("\n", 2)[1:2] if begin else []
        self.has_poses = len("".join(first).split()) > 1

    def scene(self) -> dict[str, Any]:
        objects: list[dict[str, Any]] = []
        while (mark := self.word("* before the name of an object, or a full stop at the end")) != ".":
            if mark != "*":
                raise self.fault("* before the name of an object, or a full stop at the end", mark)
            if len(objects) == MOST_SOLIDS:
                raise MapError(f"{self.what} has more than {MOST_SOLIDS:,} objects; leave some out.")
            objects.append(self.object(self.line().strip()))
        return {"name": self.text.partition("\n")[0], "world": {"collision_objects": objects}}

    def object(self, name: str) -> dict[str, Any]:
        thing: dict[str, Any] = {"id": name, "primitives": [], "primitive_poses": [], "meshes": [], "mesh_poses": []}
        if self.has_poses:
            thing["pose"] = self.pose()
        for _ in range(self.count("shapes", MOST_SOLIDS)):
            kind = self.word("the type of a shape")
            if kind == "mesh":
                thing["meshes"].append(self.mesh())
            elif kind == "plane":
                thing["planes"] = [self.numbers(4, "the coefficients of a plane")]
            elif kind in SIZES:
                sizes = self.numbers(SIZES[kind], f"the sizes of a {kind}")
                thing["primitives"].append({"type": kind, "dimensions": sizes[::-1] if kind == "cylinder" else sizes})
            else:
                raise self.fault(f"a shape, one of mesh, plane, {', '.join(SIZES)}", kind)
            thing["mesh_poses" if kind == "mesh" else "primitive_poses"].append(self.pose())
            self.numbers(4, "a colour")
        if self.has_poses:
            for _ in range(self.count("subframes", MOST_SUBFRAMES)):
                self.word("the name of a subframe")
                self.pose()
        return thing

    def mesh(self) -> dict[str, Any]:
        vertices, triangles = self.count("vertices", MOST_POINTS), self.count("triangles", 2 * MOST_POINTS)
        return {
            "vertices": [self.numbers(3, "a vertex") for _ in range(vertices)],
            "triangles": [[self.count("a vertex", MOST_POINTS) for _ in range(3)] for _ in range(triangles)],
        }

    def pose(self) -> dict[str, Any]:
        return {"position": self.numbers(3, "a position"), "orientation": self.numbers(4, "a quaternion")}

    # Words

    def word(self, expected: str) -> str:
        match = WORD.search(self.text, self.place)
        if match is None:
            raise self.fault(expected, "the end of the file")
        self.place = match.end()
        return match.group()

    def line(self) -> str:
        end = self.text.find("\n", self.place)
        end = len(self.text) if end < 0 else end
        line, self.place = self.text[self.place : end], end
        return line

    def numbers(self, count: int, what: str) -> list[float]:
        expected = f"{what}, {counted(count, 'number')}"
        words = [self.word(expected) for _ in range(count)]
        try:
            return [float(word) for word in words]
        except ValueError:
            raise self.fault(expected, " ".join(words)) from None

    def count(self, what: str, most: int) -> int:
        word = self.word(f"the number of {what}")
        if not (word.isascii() and word.isdecimal() and int(word[:9]) <= most and len(word) < 9):
            raise self.fault(f"the number of {what}, a whole number up to {most:,}", word)
        return int(word)

    def fault(self, expected: str, got: str) -> MapError:
        line = self.text.count("\n", 0, self.place) + 1
        return MapError(
            f"{self.what}, line {line}: expected {expected}, got {shown(got)}. Export the scene again in RViz (Scene "
            "Objects, Export)."
        )
