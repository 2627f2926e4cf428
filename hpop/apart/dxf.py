"""Reader of the lines and solid fills in a DXF drawing's model space, with the library ezdxf."""

from __future__ import annotations

import io
import math
from collections.abc import Iterator
from typing import Any, NamedTuple

from hpop.apart.child import FARTHEST, HIDDEN, MOST_DEEP, SAG, ChildAnswer, ChildRefused, Lines

CURVES = ("LINE", "LWPOLYLINE", "POLYLINE", "ARC", "CIRCLE", "ELLIPSE", "SPLINE", "HELIX")
FILLED = ("SOLID", "TRACE")
WIDE = ("LWPOLYLINE", "POLYLINE")


def extract(data: bytes, options: dict[str, Any]) -> ChildAnswer:
    """Return the lines of a drawing, in its units, as `Lines.answer` does.

    ``options["layers"]`` are names of layers, or None for all that are on. The words of the answer include
    ``insunits``, the code of the unit, and ``elsewhere``, the number of entities on layout sheets.
    """
    try:
        from ezdxf import recover  # of an extra
        from ezdxf.lldxf.const import DXFError  # of an extra
    except ImportError as error:
        raise ChildRefused(
            f"reading DXF drawings needs ezdxf, which cannot be imported ({error}); run pip install 'hpop[plans]'"
        ) from None
    try:
        drawing, _ = recover.read(io.BytesIO(data))
    except DXFError as error:
        raise ChildRefused(f"it cannot be read as a DXF drawing ({str(error)[:200]}); export it again as DXF") from None
    lines = Lines(options["layers"])
    frozen = {layer.dxf.name.casefold() for layer in drawing.layers if layer.is_frozen()}
    hidden = frozen | {layer.dxf.name.casefold() for layer in drawing.layers if layer.is_off()}
    walk = _EntityWalk(lines, frozen if options["layers"] is None else set())
    for placed in walk.within(drawing.modelspace(), None, "", 0):
        _add(placed, placed.layer.casefold() not in hidden, lines)
    return lines.answer(
        (layer.dxf.name for layer in drawing.layers),
        insunits=int(drawing.header.get("$INSUNITS", 0)),
        elsewhere=sum(len(layout) for layout in drawing.layouts if layout.name != "Model"),
    )


class _PlacedEntity(NamedTuple):
    """Entity with its layer and the matrix from its block to the drawing (None for the identity)."""

    entity: Any
    matrix: Any
    layer: str


class _EntityWalk:
    """Walk through the entities of a drawing, including those in blocks.

    Entities with the flag "invisible" are left out. Those on hidden layers are not, but for references to blocks on
    frozen layers.

    lines   collector of lines, which counts entities that are left out
    frozen  names of frozen layers, in lower case; a reference to a block on such a layer hides all the block's contents
    """

    def __init__(self, lines: Lines, frozen: set[str]) -> None:
        self._lines, self._frozen = lines, frozen

    def within(self, entities: Any, matrix: Any, around: str, deep: int) -> Iterator[_PlacedEntity]:
        """Yield entities that are not flagged invisible, those of a block once for each reference to the block.

        Layer 0 within a block stands for the layer of the reference. Matrices are multiplied here, because ezdxf would
        change a reference in a stretched block into a form that it can represent.

        matrix  from ``entities`` to the drawing; None for the identity
        around  layer of the reference
        deep    depth of nested blocks
        """
        lines = self._lines
        for entity in entities:
            lines.count_entity()
            layer = str(entity.dxf.get("layer", "0"))
            layer = around if layer == "0" and around else layer
            kind = entity.dxftype()
            if entity.dxf.get("invisible", 0):  # group code 60, for example for unselected states of a dynamic block
                lines.left_out["invisible"] += 1
            elif kind == "MLINE":
                yield from (_PlacedEntity(part, matrix, layer) for part in self._parts(entity))
            elif kind != "INSERT":
                yield _PlacedEntity(entity, matrix, layer)
            elif layer.casefold() in self._frozen:
                lines.left_out[HIDDEN] += 1
            elif deep == MOST_DEEP:
                lines.left_out[f"blocks more than {MOST_DEEP} deep"] += 1
            elif (block := entity.block()) is None:
                lines.left_out["INSERT without a block"] += 1
            elif block.block is not None and block.block.is_xref:
                lines.left_out["references to other drawings (XREF)"] += 1
            else:
                for reference in entity.multi_insert() if entity.mcount > 1 else (entity,):
                    lines.count_entity()
                    own = reference.matrix44()
                    whole = own if matrix is None else own @ matrix
                    yield from self.within(block, whole, layer, deep + 1)

    def _parts(self, wall: Any) -> list[Any]:
        """Return the lines, arcs and fills of an MLINE, AutoCAD's tool for walls."""
        try:
            return list(wall.virtual_entities())
        except (TypeError, ValueError, ArithmeticError, LookupError, AttributeError):
            self._lines.left_out["MLINE without a style"] += 1
            return []


def _add(placed: _PlacedEntity, shown: bool, lines: Lines) -> None:
    """Add the lines of an entity to ``lines``; ``shown`` tells whether its layer is on and not frozen."""
    from ezdxf import path  # of an extra

    entity, matrix, layer = placed
    kind = entity.dxftype()
    solid = kind in FILLED or (kind == "HATCH" and entity.dxf.solid_fill)
    if not (solid or kind in CURVES):
        lines.left_out["HATCH of a pattern" if kind == "HATCH" else kind] += 1
        return
    if not lines.wants(layer, shown=shown):
        return
    try:
        paths = [*path.from_hatch(entity)] if kind == "HATCH" else [path.make_path(entity)]
        paths = paths if matrix is None else [each.transform(matrix) for each in paths]
    except (TypeError, ValueError, ArithmeticError):  # for example a mesh, or a circle without a radius
        lines.left_out[f"{kind} without a line"] += 1
        return
    lines.add(layer, [points for each in paths for points in _polylines(each)], filled=solid)
    if kind in WIDE and entity.has_width:
        for corners in _band(entity, lines):
            placed_corners = corners if matrix is None else matrix.transform_vertices(corners)
            lines.add(layer, [[(v.x, v.y) for v in placed_corners]], filled=True)


def _band(polyline: Any, lines: Lines) -> list[Any]:
    """Return the quadrilaterals, four corners each, that a polyline with widths fills (group codes 40, 41 and 43)."""
    from ezdxf.math import Vec3  # of an extra
    from ezdxf.render.trace import TraceBuilder  # of an extra

    level = polyline.dxf.get("elevation", 0.0)
    try:
        faces = TraceBuilder.from_polyline(polyline).faces_wcs(polyline.ocs(), Vec3(level).z if level else 0.0)
        found = [list(face) for face in faces]
    except (TypeError, ValueError, ArithmeticError, LookupError, AttributeError):
        lines.left_out["widths that cannot be read"] += 1
        return []
    lines.wide += bool(found)
    return found


def _polylines(path: Any) -> Iterator[list[tuple[float, float]]]:
    """Yield the parts of a path as points (x, y); curves become chords, off by at most `SAG` times their size."""
    for part in path.sub_paths() if path.has_sub_paths else (path,):
        corners = [(v.x, v.y, v.z) for v in part.control_vertices()]
        if not corners:
            continue
        if not all(abs(value) <= FARTHEST for corner in corners for value in corner):
            raise ChildRefused(f"all coordinates of the file must be finite numbers, at most {FARTHEST:.0e}")
        size = math.dist(
            [min(axis) for axis in zip(*corners, strict=True)], [max(a) for a in zip(*corners, strict=True)]
        )
        flat = part.flattening(SAG * size) if part.has_curves and size > 0 else part.control_vertices()
        yield [(v.x, v.y) for v in flat]
