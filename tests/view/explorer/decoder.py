"""Reads `hpop-page` version 1 as its description says, with nothing of what writes it."""

from __future__ import annotations

import base64
import json
import re
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import shapely

LETTERS = {"int32": "i", "int16": "h", "float64": "d"}


def held(path: Path) -> Page:
    """Return the payload of a page."""
    found = re.search(r'<script type="application/json" id="payload">(.*?)</script>', path.read_text(encoding="utf-8"))
    assert found is not None
    return Page(json.loads(found[1]))


class Page:
    """A payload that is read: arrays in metres and seconds."""

    def __init__(self, payload: dict[str, Any]) -> None:
        assert (payload["schema"], payload["version"]) == ("hpop-page", 1)
        self.raw = payload
        self._bytes = zlib.decompress(base64.b64decode(payload["data"], validate=True))
        self.columns = {column["name"]: self.numbers(column["values"]) for column in payload["columns"]}
        paths = payload["paths"]
        self.places = self.metres(paths["x"], paths["y"])
        self.corners = self.numbers(paths["corners"]).astype(int)
        self.counts = self.numbers(paths["counts"]).astype(int)
        rings = payload["world"]["rings"]
        ends = np.cumsum(self.numbers(rings["counts"]).astype(int))
        self.rings = np.split(self.metres(rings["x"], rings["y"]), ends[:-1])
        self.traces = {trace["row"]: self.trace(trace) for trace in payload["traces"]}

    def numbers(self, packed: list[Any]) -> np.ndarray:
        kind, at, count, order = packed
        width = struct.calcsize(LETTERS[kind])
        part = self._bytes[at : at + width * count]
        assert len(part) == width * count
        whole = bytes(part[plane * count + i] for i in range(count) for plane in range(width))
        values = np.array(struct.unpack(f"<{count}{LETTERS[kind]}", whole))
        for _ in range(order):
            values = (np.cumsum(values.astype(np.int64)) + 2**31) % 2**32 - 2**31
        return values

    def metres(self, x: list[Any], y: list[Any]) -> np.ndarray:
        return np.stack([self.numbers(x), self.numbers(y)], axis=1) / 1000 + self.raw["origin"]

    def path(self, row: int) -> np.ndarray:
        """Corners (N, 2) of a row's path."""
        begin = self.counts[:row].sum()
        return self.places[self.corners[begin : begin + self.counts[row]]]

    def area(self, packed: dict[str, int]) -> shapely.Geometry:
        """Return an area by the even-odd rule."""
        found: shapely.Geometry = shapely.Polygon()
        for ring in self.rings[packed["first"] : packed["first"] + packed["count"]]:
            found = shapely.symmetric_difference(found, shapely.make_valid(shapely.Polygon(ring)))
        return found

    def trace(self, trace: dict[str, Any]) -> dict[str, Any]:
        t, values = self.numbers(trace["t"]) * trace["tick"], self.numbers(trace["values"])
        traced = [column for column in self.raw["columns"] if column["along"] is not None]
        parts = values.reshape(-1, len(t) - 1)
        return {
            "t": t,
            "places": self.metres(trace["x"], trace["y"]),
            "yaw": self.numbers(trace["yaw"]) / 1000,
            "each": {
                column["name"]: (column["adds"], step * part)
                for column, step, part in zip(traced, trace["steps"], parts, strict=True)
            },
        }
