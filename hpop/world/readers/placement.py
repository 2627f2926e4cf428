"""Convert the coordinates of a file to metres in the world: from plane coordinates, degrees on the earth, or a crs.

A crs is a coordinate reference system, such as EPSG:3857; pyproj converts it to degrees. Degrees are projected to a
plane that touches the earth.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np
import shapely
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, FloatArray
from hpop.base.options import FARTHEST, one_of
from hpop.base.text import is_number, shown
from hpop.errors import MapError
from hpop.world.geometry.shapes import check_coordinates, check_positive
from hpop.world.readers.features import Feature

RADIUS = 6378137.0
"""Radius of the earth at the equator, m (WGS 84)."""
DEGREES = "EPSG:4326"
GEOGRAPHIC = frozenset({"EPSG:4326", "EPSG:4979", "EPSG:4258", "EPSG:4269", "EPSG:4267"})
"""Coordinate systems in degrees. They are shifted by at most 200 m, so within a building they are equivalent."""
MERCATOR = frozenset({"EPSG:3857", "ESRI:102100", "EPSG:3785", "ESRI:102113"})
"""Codes of the projection of web maps."""
OLD = {"EPSG:900913": "EPSG:3857"}
CODE = re.compile(r"\b(EPSG|ESRI)\b.*?(\d{4,6})", re.IGNORECASE)
LONGITUDE_FIRST = re.compile(r".*\bCRS:?84h?", re.IGNORECASE)
MEMBERS = ("crs", "coordRefSys")
"""JSON members that declare a coordinate system: of GeoJSON 2008, and of JSON-FG."""
DEEPEST = 20
"""Deepest nesting of collections and lists that is searched for a position."""
Units = Literal["m", "deg"]
FARTHEST_UNIT = 1000 * FARTHEST
"""Greatest coordinate of a file, in the units of the file, which may be millimetres."""
MOST_DEGREES = (180.0, 90.0)
"""Greatest longitude and latitude."""
WIDEST = 0.1
"""Largest span, degrees, of a plan in degrees: 11 km. A plan that spans only 0.1 m is no building."""
SMALL = 0.01
"""Largest span, degrees, of an object in a building: 1.1 km. In metres this would be a centimetre."""
NEAR = 1.0
"""Distance, degrees, from the origin up to which lengths on the tangent plane are right to 0.02 %."""
FLATTENING = 1 / 298.257223563
"""Flattening of the earth (WGS 84)."""


def crs_of(name: Any) -> str:
    """Return the code in the name of a crs; `MapError` if it has none. Systems in `GEOGRAPHIC` all count as `DEGREES`.

    The crs with this code need not exist; see `degrees_of`.

    >>> crs_of("urn:ogc:def:crs:EPSG::3857"), crs_of("urn:ogc:def:crs:OGC:1.3:CRS84"), crs_of("EPSG:4326")
    ('EPSG:3857', 'EPSG:4326', 'EPSG:4326')
    """
    text = f"EPSG:{name}" if isinstance(name, int) and not isinstance(name, bool) else name
    text = text.strip() if isinstance(text, str) and len(text) < 200 else ""
    if LONGITUDE_FIRST.fullmatch(text):
        return DEGREES
    found = CODE.search(text)
    if found is None or found.end() != len(text):
        raise MapError(
            f"a crs must be named by its code, such as EPSG:3857 or urn:ogc:def:crs:OGC:1.3:CRS84; got {shown(name)}. "
            "Save the map again in CRS84, or give crs; give units: m if its coordinates are metres."
        )
    code = f"{found[1].upper()}:{int(found[2])}"
    code = OLD.get(code, code)
    return DEGREES if code in GEOGRAPHIC else code


def declared(member: Any) -> str | None:
    """Return the code of the crs that a JSON member ``crs`` (GeoJSON 2008) or ``coordRefSys`` (JSON-FG) declares.

    Return None for None. ``coordRefSys`` is a text in brackets, a reference, or a list with the horizontal system
    first.

    >>> declared({"type": "name", "properties": {"name": "EPSG:25832"}}), declared(None)
    ('EPSG:25832', None)
    """
    if member is None:
        return None
    if isinstance(member, list) and member:
        return declared(member[0])
    if isinstance(member, dict) and member.get("type") == "Reference":
        member = member.get("href")
    if isinstance(member, str):
        member = member.strip().removeprefix("[").removesuffix("]")
    properties = member.get("properties") if isinstance(member, dict) else None
    if not isinstance(properties, dict):
        return crs_of(member)
    name = properties.get("name", properties.get("code", properties.get("href")))
    if isinstance(member.get("type"), str) and member["type"].upper() == "EPSG":
        name = f"EPSG:{name}"
    return crs_of(name)


def declared_by(text: Mapping[str, Any], features: Sequence[Any], path: Any) -> tuple[str | None, tuple[str, ...]]:
    """Return the crs that the JSON of a file declares for its geometries, or None, and notes.

    In JSON-FG (OGC 21-045) ``coordRefSys`` is the crs of the members ``place``, which are not read, while geometries
    are in degrees. But if the first position of a file cannot be in degrees, its geometries are assumed to be in that
    crs too.
    """
    crs, system = (text.get(key) for key in MEMBERS)
    if crs is not None or system is None:
        return declared(crs), ()
    given = [item for item in features if isinstance(item, dict)]
    first = next((position for item in given if (position := _first_position(item.get("geometry")))), [0.0, 0.0])
    if any(abs(value) > most for value, most in zip(first, MOST_DEGREES, strict=True)):
        return declared(system), ()
    if all(item.get("place") is None for item in given):
        return DEGREES, ()
    return DEGREES, (
        f"{path}: its members place (JSON-FG), in {shown(system)}, are not read, only its geometries in degrees. "
        "ogr2ogr -f GeoJSON makes geometries of places.",
    )


def _first_position(geometry: Any) -> list[float]:
    """Return the first position [x, y] of a geometry in JSON; [] if there is none."""
    data = geometry
    for _ in range(2 * DEEPEST):
        if isinstance(data, dict):
            data = data.get("coordinates", data.get("geometries"))
        elif isinstance(data, list) and data and isinstance(data[0], list | dict):
            data = data[0]
    return data[:2] if isinstance(data, list) and len(data) > 1 and all(map(is_number, data[:2])) else []


def degrees_of(points: FloatArray, crs: str, what: Any) -> FloatArray:
    """Convert points (n, 2) from a crs to longitude and latitude (n, 2).

    Raises MapError without pyproj, for an unknown crs, and for points that it does not cover; ``what`` is for the
    message.
    """
    if crs == DEGREES:
        return points
    try:  # here: an extra, and slow to import
        import pyproj  # of an extra
    except ImportError:
        raise MapError(
            f"{what}: its coordinates are in {crs}; converting them to metres needs pyproj: pip install 'hpop[plans]'. "
            f"Or save the file in CRS84{_stretched(points, crs)}."
        ) from None
    try:
        transformer = pyproj.Transformer.from_crs(crs, DEGREES, always_xy=True)
    except pyproj.exceptions.ProjError:
        raise MapError(
            f"{what}: pyproj knows no crs {crs}. Save the file in CRS84, or give units: m if coordinates are metres."
        ) from None
    found = np.stack(transformer.transform(points[:, 0], points[:, 1]), axis=1)
    if not np.isfinite(found).all():
        first = points[(~np.isfinite(found)).any(axis=1).argmax()]
        raise MapError(
            f"{what}: ({first[0]:.10g}, {first[1]:.10g}) is no valid position in {crs}. Give another crs, or units: m "
            "if its coordinates are metres."
        )
    return np.asarray(found)


def on_earth(shapes: NDArray[np.object_], crs: str, what: Any) -> NDArray[np.object_]:
    """Convert geometries (n,) from a crs to longitude and latitude, without heights; see `degrees_of`."""
    flat = shapely.force_2d(shapes)
    return np.asarray(shapely.transform(flat, lambda points: degrees_of(points, crs, what)), dtype=object)


def _stretched(points: FloatArray, crs: str) -> str:
    """Return advice, for an error, on the scale that converts web-map coordinates to metres; "" for another crs."""
    if crs not in MERCATOR or not len(points):
        return ""
    return f", or give scale: {1 / math.cosh(float(points[:, 1].mean()) / RADIUS):.4g}"


@dataclass(frozen=True)
class Placement:
    """Conversion from coordinates of a file to metres.

    scale   metres per unit of the file
    origin  point of the file that becomes (0, 0); None: (0, 0), or the south-west corner of a plan in degrees
    units   "m": plane coordinates, times the scale; "deg": longitude and latitude; None: guessed
    """

    scale: float = 1.0
    origin: tuple[float, float] | None = None
    units: Units | None = None

    def __post_init__(self) -> None:
        """Check the numbers."""
        object.__setattr__(self, "scale", check_positive("scale", self.scale))
        if self.origin is not None:
            object.__setattr__(self, "origin", check_origin(self.origin))
        if self.units is not None:
            one_of("units", self.units, get_args(Units), error=MapError)
        if self.units == "deg" and self.scale != 1.0:
            raise MapError(
                "with units deg, degrees are converted to metres by the radius of the earth, so no scale is needed; "
                f"leave out scale {self.scale:g}."
            )

    def settled(self, of: Sequence[Feature], shapes: NDArray[np.object_]) -> Placement:
        """Return the placement with units and origin: those given, or else guessed from the geometries of features.

        Coordinates are degrees if all are within 180 and 90 and span less than `WIDEST` each way, as no plan in metres
        does. Raises MapError if some features look like degrees and others do not.
        """
        points, owner = shapely.get_coordinates(shapes, return_index=True)
        beyond = ~(np.abs(points) <= FARTHEST_UNIT).all(axis=1)
        if beyond.any():
            raise MapError(
                f"{of[owner[beyond.argmax()]]}: its coordinates must be finite numbers, at most {FARTHEST_UNIT:,.0f}."
            )
        south_west = points.min(axis=0) if len(points) else np.zeros(2)
        units = self.units or self._recognised(of, shapes, points)
        if units == "m":
            return replace(self, units="m", origin=self.origin or (0.0, 0.0))
        strange = (np.abs(points) > MOST_DEGREES).any(axis=1)
        if strange.any():
            first = strange.argmax()
            raise MapError(
                f"{of[owner[first]]}: ({points[first, 0]:g}, {points[first, 1]:g}) is no longitude and latitude. If "
                "metres are mixed with degrees, give all in one of them; give units: m if all are metres."
            )
        return replace(self, units="deg", origin=self.origin or (float(south_west[0]), float(south_west[1])))

    def _recognised(self, of: Sequence[Feature], shapes: NDArray[np.object_], points: FloatArray) -> Units:
        if self.scale != 1.0 or not len(points):
            return "m"
        if (np.abs(points) <= MOST_DEGREES).all() and (np.ptp(points, axis=0) < WIDEST).all():
            return "deg"
        small = _as_degrees(shapes)
        if small.any():
            who, (width, height) = "all of it" if small.all() else "the others", np.ptp(points, axis=0)
            raise MapError(
                f"{_spanned(of, shapes, small)}, and {who} {width:.4g} x {height:.4g}, as metres do. Give all in one "
                "of them, and units: m or deg to state which."
            )
        return "m"

    def refuse_degrees(self, of: Sequence[Feature], shapes: NDArray[np.object_]) -> None:
        """Raise `MapError` if all geometries of a file look like degrees although its plan is in metres.

        A plan with a scale is not checked.
        """
        small = _as_degrees(shapes)
        if self.units == "m" and self.scale == 1.0 and len(small) and small.all():
            raise MapError(f"{_spanned(of, shapes, small)}, but the plan is in metres. Give both in one of them.")

    def placed(self, points: FloatArray) -> FloatArray:
        """Convert points (n, 2) to metres; units and origin must be known, see `settled`."""
        origin = self.origin or (0.0, 0.0)
        if self.units != "deg":
            return np.asarray((points - origin) * self.scale)
        metres = _east_north(points, origin)
        if not (np.hypot(metres[:, 0], metres[:, 1]) < math.radians(NEAR) * RADIUS).all():
            raise MapError(
                f"origin ({origin[0]:g}, {origin[1]:g}), longitude and latitude, is more than {NEAR:g} degree from a "
                "point of the map; give a point of the building, or leave origin out."
            )
        return metres

    def place(self, shapes: NDArray[np.object_]) -> NDArray[np.object_]:
        """Convert geometries to metres in the plane; units and origin must be known, see `settled`."""
        placed = shapely.transform(shapely.force_2d(shapes), self.placed)
        check_coordinates(placed, "a geometry, less the origin and times the scale,")
        return np.asarray(placed, dtype=object)

    def note(self, path: Any, crs: str | None = None) -> tuple[str, ...]:
        """Return a note on the conversion of degrees or a crs to metres; () if there was none."""
        if self.units != "deg" or self.origin is None:
            return ()
        what = "degrees" if crs is None else f"in {crs}"
        return (
            f"{path}: its coordinates are {what}, put on a plane in metres, x east and y north; (0, 0) is longitude "
            f"{self.origin[0]:.7f}, latitude {self.origin[1]:.7f}. Give units: m if they are metres.",
        )


def _as_degrees(shapes: NDArray[np.object_]) -> BoolArray:
    """Return which geometries (n,) look like degrees: within 180 and 90, spans below `SMALL`, and not points."""
    bounds = shapely.bounds(shapes).reshape(-1, 4)
    spans = bounds[:, 2:] - bounds[:, :2]
    within = (np.abs(bounds) <= MOST_DEGREES * 2).all(axis=1)
    return np.asarray(within & (spans < SMALL).all(axis=1) & (spans > 0).any(axis=1))


def _spanned(of: Sequence[Feature], shapes: NDArray[np.object_], small: BoolArray) -> str:
    """Return a text for an error: the size of the first geometry marked as ``small``, which looks like degrees."""
    first = int(small.argmax())
    x0, y0, x1, y1 = shapely.bounds(shapes[first])
    return f"{of[first]} spans {x1 - x0:.3g} x {y1 - y0:.3g} at ({x0:g}, {y0:g}), as degrees do"


def check_origin(origin: Any) -> tuple[float, float]:
    """Return the point of a file that becomes (0, 0), as two finite floats; `MapError` otherwise."""
    try:
        x, y = (float(value) for value in origin)
    except (TypeError, ValueError, OverflowError):
        x = y = math.nan
    if not (abs(x) <= FARTHEST_UNIT and abs(y) <= FARTHEST_UNIT):
        raise MapError(
            f"origin must be two finite numbers (x, y) in the file's units, at most {FARTHEST_UNIT:,.0f}; got "
            f"{shown(origin)}."
        )
    return x, y


def _east_north(degrees: FloatArray, origin: tuple[float, float]) -> FloatArray:
    """Project longitude and latitude (n, 2) to the plane that touches the earth (WGS 84) at the origin, m.

    The projection is along the vertical at the origin. Lengths shrink by half the square of their distance in radians,
    2e-6 at 12 km. Points on the other half of the earth become infinite.
    """
    there, here = _on_earth(degrees), _on_earth(np.array([origin]))[0]
    longitude, latitude = np.radians(origin)
    east = np.array([-np.sin(longitude), np.cos(longitude), 0.0])
    up = np.array([np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)])
    seen = np.stack([(there - here) @ east, (there - here) @ np.cross(up, east)], axis=1)
    return np.where((there @ up > 0)[:, None], seen, np.inf)


def _on_earth(degrees: FloatArray) -> FloatArray:
    """Return points (n, 3), m from the centre of the earth; z to the north pole, x to longitude 0."""
    longitude, latitude = np.radians(degrees).T
    squared = FLATTENING * (2 - FLATTENING)  # squared eccentricity
    normal = RADIUS / np.sqrt(1 - squared * np.sin(latitude) ** 2)
    across = normal * np.cos(latitude)
    return np.stack(
        [across * np.cos(longitude), across * np.sin(longitude), normal * (1 - squared) * np.sin(latitude)], axis=1
    )
