"""Reader of XML from untrusted files: bounded in size, and without document types or entities.

An entity may expand to a thousand others, or include a local file. Neither URDF nor SRDF needs entities.
"""

from __future__ import annotations

import errno
import math
import os
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.files import read_regular
from hpop.base.options import MOST
from hpop.base.text import printable, shown
from hpop.base.xml import parsed_xml
from hpop.errors import ModelError, meant_file

MOST_BYTES = 10_000_000
"""Size of the largest file that is read."""
MOST_ELEMENTS = 100_000
LONGEST_NAME = 200
"""Largest number of characters in a link's or joint's name."""
NEARLY = 1e-11
"""Sines and cosines within this of 0 or ±1 are set to exactly that."""


class XmlFile:
    """XML file that has been read; its methods check attributes and raise errors that name the file.

    what  kind of the file for messages, "URDF"
    path  path of the file
    data  its bytes
    root  its outermost element
    """

    def __init__(self, path: str | os.PathLike[str], what: str, tag: str, most_bytes: int = MOST_BYTES) -> None:
        self.what = what
        self.path = Path(checked_path(path, what))
        self.data = file_bytes(self.path, what, most_bytes)
        self.root = parsed_xml(self.data, self.error, MOST_ELEMENTS, "remove what the arm does not need")
        if tag and self.root.tag != tag:
            raise self.error(
                f"its outermost element must be <{tag}>, got <{printable(self.root.tag)[:80]}>; give a {what} file"
            )

    def error(self, said: str) -> ModelError:
        """Return a ModelError whose message names this file and continues with ``said``."""
        return ModelError(f"{self.what} {shown(str(self.path), 400)}: {said}")

    def refuse_xacro(self, expanded: str) -> None:
        """Raise ModelError if the file is xacro (XML with macros and includes, a source of URDF files).

        expanded  name of the expanded file in the command that the message suggests
        """
        if any(element.tag.startswith("xacro:") for element in self.root.iter()):
            raise self.error(
                f"it must be plain XML, but it is xacro; expand it: xacro {printable(self.path.name)[:80]} > "
                f"{expanded} (a command of ROS, also installed by pip install xacro)"
            )

    def name(self, element: Element, attribute: str = "name") -> str:
        """Return the name in an attribute of an element; ModelError if it is missing or too long."""
        given = element.get(attribute)
        if not given or len(given) > LONGEST_NAME:
            raise self.error(
                f"<{element.tag}> needs a {attribute} of 1 to {LONGEST_NAME} characters, got {shown(given)}"
            )
        return given

    def number(self, where: str, given: str | None) -> float:
        """Return the number in an attribute's text ``given``; ``where`` describes the attribute in a ModelError."""
        return float(self.numbers(where, given, 1)[0])

    def numbers(self, where: str, given: str | None, count: int) -> FloatArray:
        """Return the ``count`` numbers, separated by spaces, in an attribute's text ``given``.

        ``where`` describes the attribute in a ModelError.
        """
        try:
            values = [float(word) for word in (given or "").split()[: count + 1]]
        except ValueError:
            values = []
        if len(values) != count or not all(abs(value) <= MOST for value in values):
            kind = "a number" if count == 1 else f"{count} numbers"
            raise self.error(f"{where} must be {kind} of at most {MOST:,.0f}, got {shown(given)}")
        return np.array(values)


def checked_path(path: Any, what: str) -> str:
    """Check that a value is a path and return it as text; ``what`` names the file in a ModelError."""
    if not isinstance(path, str | os.PathLike) or not isinstance(os.fspath(path), str) or not os.fspath(path):
        raise ModelError(f"the {what} must be given as the path of a file, got {shown(path)}")
    return str(os.fspath(path))


def file_bytes(path: Path, what: str, most: int) -> bytes:
    """Return the bytes of a file of at most ``most`` bytes; ModelError, which calls it ``what``, if that fails."""
    try:
        data = read_regular(path, most)
    except OSError as error:
        way = (
            "make it smaller (decimate a mesh)" if error.errno == errno.EFBIG else f"check the path.{meant_file(path)}"
        )
        raise ModelError(
            f"the {what} {shown(str(path), 400)} cannot be opened: {error.strerror or error}; {way}"
        ) from None
    if not data:
        raise ModelError(f"the {what} {shown(str(path), 400)} must not be empty, but it has no bytes; restore the file")
    return data


def pose_of(xyz: FloatArray, rpy: FloatArray) -> FloatArray:
    """Return a pose (4, 4) from a position, m, and roll, pitch, yaw, rad, about the fixed axes x, y, z in this order.

    Sines and cosines that are 0 or ±1 except for rounded decimals in the file (1.57079632679) are made exact, because
    the kinematics omit such terms.
    """
    cosines, sines = (np.array([[exact(f(angle)) for angle in rpy]]) for f in (math.cos, math.sin))
    (cr, cp, cy), (sr, sp, sy) = cosines[0], sines[0]
    pose = np.eye(4)
    pose[:3, :3] = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    pose[:3, 3] = xyz
    return pose


def exact(value: float) -> float:
    """Return 0, 1 or -1 if a value is within 1e-11 of it, and otherwise the value itself.

    No pose then changes by more than about 1e-10 m.

    >>> exact(math.cos(1.57079632679)), exact(0.5)
    (0.0, 0.5)
    """
    nearest = round(value)
    return float(nearest) if abs(value - nearest) < NEARLY and abs(nearest) <= 1 else value
