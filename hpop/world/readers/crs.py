"""Coordinate reference systems (crs) of files, and their coordinates as longitude and latitude, by pyproj."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from hpop.base.arrays import FloatArray
from hpop.base.text import shown
from hpop.errors import MapError

RADIUS = 6378137.0
"""The earth's at the equator, of WGS 84, m."""
DEGREES = "EPSG:4326"
GEOGRAPHIC = frozenset({"EPSG:4326", "EPSG:4979", "EPSG:4258", "EPSG:4269", "EPSG:4267"})
"""Systems of degrees that are within 200 m of each other: of a building they are the same."""
MERCATOR = frozenset({"EPSG:3857", "ESRI:102100", "EPSG:3785", "ESRI:102113"})
"""What web maps are drawn in."""
OLD = {"EPSG:900913": "EPSG:3857"}
CODE = re.compile(r"\b(EPSG|ESRI)\b.*?(\d{4,6})", re.IGNORECASE)
LONGITUDE_FIRST = re.compile(r".*\bCRS:?84h?", re.IGNORECASE)


def crs_of(name: Any) -> str:
    """Return the code of a crs by its name, or `MapError`; degrees of any datum are `DEGREES`.

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
            f"a crs is named by its code, such as EPSG:3857 or urn:ogc:def:crs:OGC:1.3:CRS84; got {shown(name)}. Save "
            "the file again in CRS84, or give crs; units: m says that its coordinates are metres."
        )
    code = f"{found[1].upper()}:{int(found[2])}"
    code = OLD.get(code, code)
    return DEGREES if code in GEOGRAPHIC else code


def declared(member: Any) -> str | None:
    """Return the crs that a file's member ``crs`` names (GeoJSON 2008, which RFC 7946 dropped); None where it has none.

    >>> declared({"type": "name", "properties": {"name": "EPSG:25832"}}), declared(None)
    ('EPSG:25832', None)
    """
    if member is None:
        return None
    properties = member.get("properties") if isinstance(member, dict) else None
    if not isinstance(properties, dict):
        return crs_of(member)
    name = properties.get("name", properties.get("code", properties.get("href")))
    if isinstance(member.get("type"), str) and member["type"].upper() == "EPSG":
        name = f"EPSG:{name}"
    return crs_of(name)


def degrees_of(points: FloatArray, crs: str, what: Any) -> FloatArray:
    """Return points (n, 2) of a crs, in its units, as longitude and latitude (n, 2); `MapError` without pyproj."""
    if crs == DEGREES:
        return points
    try:  # here: an extra, and slow to import
        import pyproj
    except ImportError:
        raise MapError(
            f"{what}: its coordinates are in {crs}, which pyproj turns into metres, of the extra hpop[plans]: pip "
            f"install 'hpop[plans]'. Or save the file in CRS84{_stretched(points, crs)}."
        ) from None
    try:
        transformer = pyproj.Transformer.from_crs(crs, DEGREES, always_xy=True)
    except pyproj.exceptions.ProjError:
        raise MapError(
            f"{what}: pyproj knows no crs {crs}. Save the file in CRS84; units: m says that its coordinates are metres."
        ) from None
    found = np.stack(transformer.transform(points[:, 0], points[:, 1]), axis=1)
    if not np.isfinite(found).all():
        first = points[(~np.isfinite(found)).any(axis=1).argmax()]
        raise MapError(
            f"{what}: ({first[0]:.10g}, {first[1]:.10g}) is no place in {crs}. units: m says that its coordinates are "
            "metres."
        )
    return np.asarray(found)


def on_earth(shapes: NDArray[np.object_], crs: str, what: Any) -> NDArray[np.object_]:
    """Return geometries (n,) of a crs in longitude and latitude."""
    flat = shapely.force_2d(shapes)
    return np.asarray(shapely.transform(flat, lambda points: degrees_of(points, crs, what)), dtype=object)


def _stretched(points: FloatArray, crs: str) -> str:
    """Say what scale makes metres of a web map's coordinates."""
    if crs not in MERCATOR or not len(points):
        return ""
    return f", or give scale: {1 / math.cosh(float(points[:, 1].mean()) / RADIUS):.4g}"
