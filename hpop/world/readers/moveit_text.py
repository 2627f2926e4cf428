"""Reader of MoveIt's ``.scene`` files, the text that its panel "Scene Objects" exports.

The first line is the name of the scene. An object is ``* NAME``, its position, its quaternion, the number of its
shapes, the shapes, the number of its subframes, and the subframes. Files of before 2020 have neither the pose nor the
subframes. A shape is its type, its sizes, its position, its quaternion, and its colour. The last line is a full stop.
"""

from __future__ import annotations

import re
from typing import Any

from hpop.base.text import counted, shown
from hpop.errors import MapError
from hpop.world.geometry.solids import MOST_POINTS, MOST_SOLIDS

SIZES = {"box": 3, "sphere": 1, "cylinder": 2, "cone": 2}
"""Number of sizes of a shape: x, y, z; radius; radius and length."""
MOST_SUBFRAMES = 1_000
OBJECT = re.compile(r"^\*[^\S\n]", re.MULTILINE)
WORD = re.compile(r"\S+")


def is_scene_text(text: str) -> bool:
    """Return whether a text is a scene in this format; YAML has no lines that begin with an asterisk and a space."""
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
