"""Schema of scenario files: their keys and values, which pydantic checks strictly."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Annotated, Any, ClassVar, Literal

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    Strict,
    ValidationError,
    ValidatorFunctionWrapHandler,
    WithJsonSchema,
    WrapValidator,
    create_model,
)
from pydantic_core import PydanticCustomError

from hpop.base.options import Degrees
from hpop.base.registry import hints_of, model_parameters
from hpop.base.text import shown
from hpop.world.readers.geojson_content import FLOW_WIDTH

STRICT = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, defer_build=True)
PARAMETERS = ConfigDict(**STRICT, arbitrary_types_allowed=True, protected_namespaces=())
DEFAULT_MODEL = "differential_drive"
DEFAULT_PLANNER = "lattice"
Paths = str | list[str]
Choice = str | int | float | bool
Named = dict[str, dict[str, Any] | None]
Entry = dict[str, Any]


def _form(what: str) -> WrapValidator:
    """Return a validator that reports any fault in a short list as one fault of the whole list: "expected ``what``".

    A fault of "entry 2" would not say which form is expected.
    """

    def check(value: Any, handler: ValidatorFunctionWrapHandler) -> Any:
        try:
            return handler(value)
        except ValidationError:
            raise PydanticCustomError("form", "expected {what}", {"what": what}) from None

    return WrapValidator(check)


# Text is parsed where the value is used, because the error is more precise there.
Angle = Annotated[float | str, WithJsonSchema({"anyOf": [{"type": "number"}, Degrees.json_schema()]})]
# Lists of JSON are accepted as tuples; their items are still checked strictly.
Pair = Annotated[tuple[float, float], Strict(False)]
Triple = Annotated[tuple[float, float, float], Strict(False)]
Angles = Annotated[tuple[Angle, Angle, Angle], Strict(False)]
Quaternion = Annotated[tuple[float, float, float, float], Strict(False)]
Origin = Annotated[tuple[float, float, float], Strict(False), _form("an origin [x, y, yaw] in m, m and rad")]
Point = Annotated[Pair, _form("a point [x, y] in m")]
Heights = Annotated[Pair, _form("heights [z_min, z_max] in m")]


Waypoint = Annotated[Triple, _form("a waypoint [t, x, y] in s, m and m")]
Points = list[Annotated[Triple, _form("a point [x, y, z] in m")]]


class _Strict(BaseModel):
    model_config = STRICT


class MapFile(_Strict):
    """Map file, with the options of its reader.

    files   keys of paths, which are relative to the scenario's folder
    beside  keys for further files of the world, which are not options of the reader
    """

    files: ClassVar[frozenset[str]] = frozenset({"path"})
    beside: ClassVar[frozenset[str]] = frozenset()
    path: str  # file, relative to the scenario


class RosMap(MapFile):
    """ROS map_server map; ``keep_out`` is a mask of the same kind."""

    files = frozenset({"path", "keep_out"})
    unknown_is_free: bool = False
    keep_out: str | None = None
    height: Heights | None = None


class MovingAI(MapFile):
    """MovingAI grid map; ``resolution`` is the side of a cell, m."""

    resolution: float = Field(default=1.0, gt=0)  # m, side of a cell


class ContentFile(_Strict):
    """GeoJSON file of landmarks, flows or zones; with ``where`` only features with these properties are read."""

    path: str  # file, relative to the scenario
    where: dict[str, Choice | list[Choice]] | None = None  # properties that its features must have


ContentFiles = str | ContentFile | list[str | ContentFile]


class GeoJSON(MapFile):
    """GeoJSON floor plan in degrees, or in units: (coordinates - ``origin``) * ``scale`` are metres.

    Further files, of the same scale, origin and units, may hold points as landmarks, lines as flows of visitors,
    ``flow_width`` m wide, and polygons as zones.
    """

    beside = frozenset({"landmarks", "flows", "zones", "flow_width"})
    scale: float = Field(default=1.0, gt=0)
    origin: Annotated[Pair, _form("an origin [x, y] in the file's units")] | None = None
    polygons: Literal["obstacles", "free", "outline", "rooms"] = "obstacles"
    units: Literal["m", "deg"] | None = None
    wall_width: float | None = Field(default=None, gt=0)
    crs: str | None = None  # coordinate system, such as EPSG:3857; by default the file's own
    where: dict[str, Choice | list[Choice]] | None = None  # properties that its features must have
    landmarks: ContentFiles = []  # GeoJSON files whose points are landmarks
    flows: ContentFiles = []  # GeoJSON files whose lines are flows of visitors: one-way zones
    zones: ContentFiles = []  # GeoJSON files whose polygons are zones
    flow_width: float = Field(default=FLOW_WIDTH, gt=0)  # m, across a flow


class Image(MapFile):
    """Blueprint image in which dark is obstacle; ``resolution`` is the side of a pixel, m."""

    resolution: float = Field(gt=0)
    threshold: float = Field(default=0.5, gt=0, lt=1)
    smallest_obstacle: float | None = Field(default=None, gt=0)
    thinnest_obstacle: float | None = Field(default=None, gt=0)  # m; thinner lines are no obstacle
    inside: Point | None = None
    origin: Origin = (0.0, 0.0, 0.0)
    height: Heights | None = None
    contrast: bool = False  # from the colours of obstacles


class RosBag(MapFile):
    """Map in a bag, a nav_msgs/OccupancyGrid on ``topic``."""

    topic: str | None = None
    unknown_is_free: bool = False
    height: Heights | None = None


class Drawing(MapFile):
    """Floor plan of lines; all lengths in m, ``origin`` in the drawing's units."""

    scale: float | None = Field(default=None, gt=0)
    layers: Paths | None = None
    wall_width: float = Field(default=0.05, gt=0)  # m, thickness of a line
    inside: Point | None = None  # m, [x, y]: all that is unreachable from there is solid
    origin: Annotated[Pair, _form("an origin [x, y] in the drawing's units")] = (0.0, 0.0)
    door_arcs: Literal["closed", "open"] = "closed"  # whether the swing arcs of doors are walls


class DXF(Drawing):
    """Floor plan in DXF; ``scale`` is metres per unit, if the drawing does not state its units."""


class PDF(Drawing):
    """Floor plan in PDF; ``scale`` is metres per point, ``ratio`` 100 for a plan at 1:100."""

    ratio: float | None = Field(default=None, gt=0)
    page: int = Field(default=1, ge=1)


class PrismEntry(_Strict):
    """Obstacle with corners in m, between two heights; unlimited height by default."""

    corners: list[Point] = Field(min_length=3)  # m, [x, y] each
    height: Heights | None = None  # m, [z_min, z_max]; unlimited by default
    contrast: float = Field(default=1.0, ge=0, le=1)  # of its surface, a weight in optic_flow


class Polygons(_Strict):
    """Obstacles as polygons; the robot stays in ``extent`` (default: their bounding box) and out of ``keep_out``."""

    obstacles: list[PrismEntry] = []  # upright, each with its corners
    extent: list[Point] | None = Field(default=None, min_length=3)  # m, corners of the area for the robot
    keep_out: list[list[Point]] = []  # m, corners of areas that the robot may not enter


class MoveItScene(MapFile):
    """Planning scene of MoveIt or MotionBenchMaker, in YAML or in MoveIt's text format."""


class CylinderSize(_Strict):
    """Cylinder, m; its axis is z."""

    radius: float = Field(gt=0)  # m
    length: float = Field(gt=0)  # m, along z


class PointCloud(MapFile):
    """Point cloud in PLY or PCD; ``resolution`` is the side of the cells that cover its points, m."""

    resolution: float = Field(gt=0)  # m, side of a cell


class SolidEntry(_Strict):
    """Solid in space, m, of exactly one shape; rotated by angles in rad, or as text such as "90 deg"."""

    box: Annotated[Triple, _form("a size [x, y, z] in m")] | None = None  # m, its size [x, y, z]
    cylinder: CylinderSize | None = None  # upright, unless it is rotated
    sphere: float | None = Field(default=None, gt=0)  # m, its radius
    hull: Points | None = Field(default=None, min_length=4)  # m, points [x, y, z] that it encloses
    position: Annotated[Triple, _form("a position [x, y, z] in m")] = (0.0, 0.0, 0.0)  # m, of its centre
    rpy: Annotated[Angles, _form("[roll, pitch, yaw] in rad or as '90 deg'")] | None = None  # rad, or as '90 deg'
    quaternion: Annotated[Quaternion, _form("a quaternion [x, y, z, w]")] | None = None  # [x, y, z, w], instead of rpy
    name: str = ""  # in messages and pictures


class CommonRoad(MapFile):
    """Road in CommonRoad XML; with ``start: planning_problem``, or this as goal, they are those of the file."""

    beside = frozenset({"planning_problem"})
    height: Heights | None = None  # m, [z_min, z_max] of obstacles; unlimited by default
    traffic: bool = True  # whether vehicles that move are read
    planning_problem: int | None = None  # number of the planning problem, if the file has several


class Solids(_Strict):
    """Solids in space; robots in the plane stay in ``extent``, by default the bounding box and 1 m on each side."""

    obstacles: list[Entry] = []  # boxes, cylinders, spheres and hulls
    extent: list[Point] | None = Field(default=None, min_length=3)  # m, corners of the area for robots in the plane


class WorldSection(_Strict):
    """World section of a scenario: exactly one of these keys is given."""

    ros_map: RosMap | None = None
    ros_bag: RosBag | None = None
    movingai: MovingAI | None = None
    geojson: GeoJSON | None = None
    image: Image | None = None
    dxf: DXF | None = None
    pdf: PDF | None = None
    polygons: Polygons | None = None
    moveit_scene: MoveItScene | None = None
    point_cloud: PointCloud | None = None
    solids: Solids | None = None
    commonroad: CommonRoad | None = None


class ReaderFile(BaseModel):
    """Map file of an installed package's reader, with the reader's options."""

    model_config = ConfigDict(extra="allow", strict=True, allow_inf_nan=False, defer_build=True)
    path: str  # file, relative to the scenario


class Prediction(_Strict):
    """Keys for the uncertainty and the end of a person's prediction."""

    radius: float = Field(default=0.25, gt=0)
    spread: float = Field(default=0.0, ge=0)
    growth: float = Field(default=0.0, ge=0)  # m/s; standard deviation at t s: √(spread² + (growth t)²), up to until
    until: float | None = Field(default=None, ge=0)
    afterwards: Literal["gone", "stays"] = "gone"


class FutureEntry(_Strict):
    """Possible future of a person: walking at a velocity, m/s, or through waypoints; otherwise standing."""

    weight: float = Field(gt=0)  # weight relative to the other futures
    velocity: Annotated[Pair, _form("a velocity [x, y] in m/s")] = (0.0, 0.0)  # [x, y] m/s
    waypoints: list[Waypoint] | None = Field(default=None, min_length=2)  # [t s, x m, y m] each, times rising
    spread: float | None = Field(default=None, ge=0)  # m, as the person's if left out
    growth: float | None = Field(default=None, ge=0)  # m/s, as the person's if left out
    until: float | None = Field(default=None, ge=0)  # s, when this future ends; as the person's if left out
    afterwards: Literal["gone", "stays"] | None = None  # as the person's if left out


class PersonEntry(Prediction):
    """Person at ``x``, ``y``, m, who stands, walks at a velocity, m/s, or has several futures.

    The yaw is in rad or text such as "90 deg"; by default along the velocity.
    """

    x: float
    y: float
    yaw: Angle | None = None
    velocity: Annotated[Pair, _form("a velocity [x, y] in m/s")] = (0.0, 0.0)
    futures: list[FutureEntry] = []
    name: str = ""  # in messages and pictures


class WaypointsEntry(Prediction):
    """Person with ``waypoints``, through which the person is predicted to walk."""

    waypoints: list[Waypoint] = Field(min_length=2)  # [t s, x m, y m] each, times rising; 0 s is now
    name: str = ""  # in messages and pictures


class TrackEntry(Prediction):
    """People with recorded tracks in a file, ``track``: all of them or some; each is named by its id."""

    track: str  # file, relative to the scenario: CSV (id, t or frame, x, y), PeTrack, obsmat.txt or JuPedSim
    frame_rate: float | None = Field(default=None, gt=0)  # frames per second, if the file does not state it
    unit: Literal["m", "cm", "mm"] | None = None  # of positions, if the file does not state it; else m
    format: Literal["csv", "petrack", "obsmat", "jupedsim"] | None = None  # of the file; recognised by default
    id: int | str | list[int | str] | None = None  # people of the file; all by default
    begin: float = 0.0  # s, time of the recording that becomes now
    name: str = ""  # of one person; of several the prefix of their ids


class LandmarkEntry(_Strict):
    """Point of interest, m; ``facing`` is in rad or text such as "90 deg"."""

    x: float
    y: float
    z: float = 1.5
    facing: Angle | None = None
    weight: float = Field(default=1.0, gt=0)
    name: str = ""  # in messages and pictures


class ZoneEntry(_Strict):
    """Area, m, with a speed ``limit``, m/s, or closed, or one-way along a ``path``, m."""

    kind: Literal["speed", "keep-out", "one-way"]
    area: list[Point] = Field(min_length=3)
    limit: float | None = Field(default=None, gt=0)
    path: list[Point] | None = Field(default=None, min_length=2)
    name: str = ""  # in messages and pictures


class FieldEntry(_Strict):
    """Quantity that was measured over the floor, read from a file; bilinear between its samples."""

    name: str = Field(min_length=1)  # for criteria and pictures
    path: str  # file, relative to the scenario: CSV (x, y, name), NumPy, grey image, or yaml of map_server
    unit: str = Field(min_length=1)  # of the values, such as dBm
    spacing: float | None = Field(default=None, gt=0)  # m, between samples; stated in CSV and yaml files
    origin: Origin | None = None  # [x, y, yaw] of the lower-left corner of an image, or of the first sample
    outside: float | None = None  # value where nothing was measured; without it all free space must be covered
    range: Annotated[Pair, _form("two values [low, high]")] | None = None  # values of black and white, or of 0 and 100


class StopEntry(_Strict):
    """Stop of a tour: a disc of positions (``at`` and ``within``, m), a goal by name, or a landmark that is seen."""

    at: Point | None = None  # m, [x, y]: any position at most `within` away, with any heading
    within: float | None = None  # m, largest distance from `at`; or from the camera to the landmark, 3 by default
    landmark: str | None = None  # name of a landmark that the camera must see
    dwell: float = 0.0  # s, how long the robot stands there
    name: str = ""  # in messages, tables and pictures
    optional: bool = False  # whether it may be skipped, at a cost in stops_missed


def stop_words(values: Any, place: Sequence[str | int], text: str) -> str:
    """Return the stop of a tour to which a position belongs, such as " (stop 'hall')", for an error; "" for none.

    text  text of the error; the result is "" if it names the stop
    """
    match [*place]:
        case ["tour", "stops", int(i), *_]:
            entry = values["tour"]["stops"][i]
            names = [entry.get(key) for key in ("name", "landmark")] if isinstance(entry, dict) else []
            name = next((name for name in names if isinstance(name, str) and name), None)
            stop = f"stop {i + 1}" if name is None else f"stop {shown(name)}"
            return "" if stop in text else f" ({stop})"
    return ""


TwoStops = Annotated[list[int | str], Field(min_length=2, max_length=2)]


class TourSection(_Strict):
    """Stops to visit on the way to the goal.

    order  given: as listed, the default; any: in any order; or a list of pairs, with the meaning of some
    some   instead of order: pairs of stops, by name (or index from 0), the first to be visited before the second
    """

    order: Literal["given", "any"] | list[TwoStops] | None = None
    some: list[TwoStops] | None = None
    stops: list[Entry] = Field(min_length=1)  # discs of positions, goals or landmarks


class Choose(_Strict):
    """Preference that marks a trajectory "for you"."""

    preference: str  # file that `hpop prefer` wrote, relative to the scenario


class ScenarioFile(_Strict):
    """Top-level keys of a scenario file."""

    world: WorldSection
    model: str | Named = DEFAULT_MODEL
    view: Entry | None = None  # parameters of the model "view"
    start: Any  # the model checks these two
    goal: Any
    criteria: list[str | Named] = Field(min_length=1)
    quanta: dict[str, float] = {}
    planner: str | Named | Annotated[list[str | Named], Field(min_length=1)] = DEFAULT_PLANNER
    horizon: float | None = Field(default=None, gt=0)
    people: list[Entry] = []
    groups: list[Annotated[list[int | str], Field(min_length=2)]] = []
    landmarks: list[Entry] = []
    zones: list[Entry] = []
    fields: list[Entry] = []
    tour: TourSection | None = None
    choose: Choose | None = None


def parameters_of(cls: Any) -> type[BaseModel]:
    """Return a schema for the fields of a dataclass.

    A field that is a robot model is given as its name, or as {name: parameters}.
    """
    hints = hints_of(cls) | dict.fromkeys(model_parameters(cls), str | dict[str, Any])
    schema: dict[str, Any] = {}
    for field in dataclasses.fields(cls):
        if field.init:
            optional = not (field.default is field.default_factory is dataclasses.MISSING)
            schema[field.name] = (hints.get(field.name, Any), None if optional else ...)
    return create_model(cls.__name__, __config__=PARAMETERS, **schema)
