"""The form of a scenario file: its keys and what may stand there, strictly."""

from __future__ import annotations

import dataclasses
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
    """Return one fault for a short list as a whole: that its entry 2 is missing does not say what that entry is."""

    def check(value: Any, handler: ValidatorFunctionWrapHandler) -> Any:
        try:
            return handler(value)
        except ValidationError:
            raise PydanticCustomError("form", "expected {what}", {"what": what}) from None

    return WrapValidator(check)


# What text says is read where the value is used, which tells more than that it is no angle.
Angle = Annotated[float | str, WithJsonSchema({"anyOf": [{"type": "number"}, Degrees.json_schema()]})]
# A validator is given JSON's lists, which strictly are no tuples; what is in them stays strict.
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
    """What a reader reads, and its options.

    files   keys of paths, which are relative to the scenario's folder
    beside  keys that are no options of the reader: what else is read into the world
    """

    files: ClassVar[frozenset[str]] = frozenset({"path"})
    beside: ClassVar[frozenset[str]] = frozenset()
    path: str  # file, relative to the scenario


class RosMap(MapFile):
    """A ROS map_server map; ``keep_out`` is a mask of the same kind."""

    files = frozenset({"path", "keep_out"})
    unknown_is_free: bool = False
    keep_out: str | None = None
    height: Heights | None = None


class MovingAI(MapFile):
    """A MovingAI grid map; ``resolution`` is the side of a cell, m."""

    resolution: float = Field(default=1.0, gt=0)  # m, side of a cell


class ContentFile(_Strict):
    """A GeoJSON file of landmarks, flows or zones, of which the features that have some properties are read."""

    path: str  # file, relative to the scenario
    where: dict[str, Choice | list[Choice]] | None = None  # properties that its features must have


ContentFiles = str | ContentFile | list[str | ContentFile]


class GeoJSON(MapFile):
    """A GeoJSON floor plan; coordinates less ``origin`` times ``scale`` are metres, or they are degrees.

    Other files, of the same scale, origin and units, may hold points that are landmarks, lines that are flows of
    visitors ``flow_width`` m across, and polygons that are zones.
    """

    beside = frozenset({"landmarks", "flows", "zones", "flow_width"})
    scale: float = Field(default=1.0, gt=0)
    origin: Annotated[Pair, _form("an origin [x, y] in the file's units")] | None = None
    polygons: Literal["obstacles", "free", "outline", "rooms"] = "obstacles"
    units: Literal["m", "deg"] | None = None
    wall_width: float | None = Field(default=None, gt=0)
    crs: str | None = None  # of the coordinates, such as EPSG:3857; what the file says if left out
    where: dict[str, Choice | list[Choice]] | None = None  # properties that its features must have
    landmarks: ContentFiles = []  # GeoJSON files whose points are landmarks
    flows: ContentFiles = []  # GeoJSON files whose lines are flows of visitors: one-way zones
    zones: ContentFiles = []  # GeoJSON files whose polygons are zones
    flow_width: float = Field(default=FLOW_WIDTH, gt=0)  # m, across a flow


class Image(MapFile):
    """A blueprint image in which dark is obstacle; ``resolution`` is the side of a pixel, m."""

    resolution: float = Field(gt=0)
    threshold: float = Field(default=0.5, gt=0, lt=1)
    smallest_obstacle: float | None = Field(default=None, gt=0)
    thinnest_obstacle: float | None = Field(default=None, gt=0)  # m, below which lines are none: swings of doors
    inside: Point | None = None
    origin: Origin = (0.0, 0.0, 0.0)
    height: Heights | None = None


class RosBag(MapFile):
    """The map in a bag, a nav_msgs/OccupancyGrid on ``topic``."""

    topic: str | None = None
    unknown_is_free: bool = False
    height: Heights | None = None


class Drawing(MapFile):
    """A floor plan of lines; all lengths in m, ``origin`` in the drawing's units."""

    scale: float | None = Field(default=None, gt=0)
    layers: Paths | None = None
    wall_width: float = Field(default=0.05, gt=0)  # m, how thick a line is
    inside: Point | None = None  # m, [x, y]: what cannot be reached from there is solid
    origin: Annotated[Pair, _form("an origin [x, y] in the drawing's units")] = (0.0, 0.0)
    door_arcs: Literal["closed", "open"] = "closed"  # whether arcs along which doors swing are walls


class DXF(Drawing):
    """A floor plan in DXF; ``scale`` is metres a unit, where the drawing does not say its units."""


class PDF(Drawing):
    """A floor plan in PDF; ``scale`` is metres a point, ``ratio`` 100 for a plan at 1:100."""

    ratio: float | None = Field(default=None, gt=0)
    page: int = Field(default=1, ge=1)


class Prism(_Strict):
    """An obstacle: corners in m, and the heights between which it stands; without, the whole height."""

    corners: list[Point] = Field(min_length=3)  # m, [x, y] each
    height: Heights | None = None  # m, [z_min, z_max]; the whole height without


class Polygons(_Strict):
    """Obstacles written out; the robot stays in ``extent`` and off ``keep_out``."""

    obstacles: list[Prism] = []  # upright, each with its corners
    extent: list[Point] | None = Field(default=None, min_length=3)  # m, corners of where the robot stays
    keep_out: list[list[Point]] = []  # m, corners of areas that it may not enter


class MoveItScene(MapFile):
    """A planning scene of MoveIt or MotionBenchMaker, in YAML."""


class CylinderSize(_Strict):
    """A cylinder, m; its axis is z."""

    radius: float = Field(gt=0)  # m
    length: float = Field(gt=0)  # m, along z


class SolidEntry(_Strict):
    """A solid in space, m, of exactly one shape; turned by angles in rad, or as text such as "90 deg"."""

    box: Annotated[Triple, _form("a size [x, y, z] in m")] | None = None  # m, its size [x, y, z]
    cylinder: CylinderSize | None = None  # upright, unless it is turned
    sphere: float | None = Field(default=None, gt=0)  # m, its radius
    hull: Points | None = Field(default=None, min_length=4)  # m, points [x, y, z] round which it lies
    position: Annotated[Triple, _form("a position [x, y, z] in m")] = (0.0, 0.0, 0.0)  # m, of its middle
    rpy: Annotated[Angles, _form("[roll, pitch, yaw] in rad or as '90 deg'")] | None = None  # rad, or as '90 deg'
    quaternion: Annotated[Quaternion, _form("a quaternion [x, y, z, w]")] | None = None  # [x, y, z, w], in place of rpy
    name: str = ""  # in messages and pictures


class Solids(_Strict):
    """Solids in space written out; robots in the plane stay in ``extent``."""

    obstacles: list[Entry] = []  # boxes, cylinders, spheres and hulls
    extent: list[Point] | None = Field(default=None, min_length=3)  # m, corners of where robots in the plane stay


class WorldSection(_Strict):
    """Exactly one of the ways to give a world."""

    ros_map: RosMap | None = None
    ros_bag: RosBag | None = None
    movingai: MovingAI | None = None
    geojson: GeoJSON | None = None
    image: Image | None = None
    dxf: DXF | None = None
    pdf: PDF | None = None
    polygons: Polygons | None = None
    moveit_scene: MoveItScene | None = None
    solids: Solids | None = None


class ReaderFile(BaseModel):
    """What an installed package's reader reads, and its options."""

    model_config = ConfigDict(extra="allow", strict=True, allow_inf_nan=False, defer_build=True)
    path: str  # file, relative to the scenario


class Prediction(_Strict):
    """How sure it is where people will be, and until when it is predicted."""

    radius: float = Field(default=0.25, gt=0)
    spread: float = Field(default=0.0, ge=0)
    growth: float = Field(default=0.0, ge=0)
    until: float | None = Field(default=None, ge=0)
    afterwards: Literal["gone", "stays"] = "gone"


class FutureEntry(_Strict):
    """One of several things that a person may do: walk at a velocity, m/s, or through waypoints; else stand."""

    weight: float = Field(gt=0)  # how much it counts beside the others
    velocity: Annotated[Pair, _form("a velocity [x, y] in m/s")] = (0.0, 0.0)  # [x, y] m/s
    waypoints: list[Waypoint] | None = Field(default=None, min_length=2)  # [t s, x m, y m] each, times rising
    spread: float | None = Field(default=None, ge=0)  # m, as the person's if left out
    growth: float | None = Field(default=None, ge=0)  # m/s, as the person's if left out
    until: float | None = Field(default=None, ge=0)  # s, when this future ends; as the person's if left out
    afterwards: Literal["gone", "stays"] | None = None  # as the person's if left out


class PersonEntry(Prediction):
    """A person, m, m/s, who stands, walks at a velocity, or has several futures.

    The yaw is in rad or text such as "90 deg"; left out, it is where the velocity leads.
    """

    x: float
    y: float
    yaw: Angle | None = None
    velocity: Annotated[Pair, _form("a velocity [x, y] in m/s")] = (0.0, 0.0)
    futures: list[FutureEntry] = []
    name: str = ""  # in messages and pictures


class WaypointsEntry(Prediction):
    """A person who is predicted to walk through waypoints."""

    waypoints: list[Waypoint] = Field(min_length=2)  # [t s, x m, y m] each, times rising; 0 s is now
    name: str = ""  # in messages and pictures


class TrackEntry(Prediction):
    """People whose recorded tracks are in a file, all of them or some; each is called by its id."""

    track: str  # file, relative to the scenario: CSV (id, t or frame, x, y), PeTrack, obsmat.txt or JuPedSim
    frame_rate: float | None = Field(default=None, gt=0)  # frames a second, where the file does not say it
    unit: Literal["m", "cm", "mm"] | None = None  # of places, where the file does not say it; else m
    format: Literal["csv", "petrack", "obsmat", "jupedsim"] | None = None  # of the file; as it looks if left out
    id: int | str | list[int | str] | None = None  # who of the file; all if left out
    begin: float = 0.0  # s, the moment of the recording that is now
    name: str = ""  # of one person; of several what their ids follow


class LandmarkEntry(_Strict):
    """A point of interest, m; where it faces in rad or as text such as "90 deg"."""

    x: float
    y: float
    z: float = 1.5
    facing: Angle | None = None
    weight: float = Field(default=1.0, gt=0)
    name: str = ""  # in messages and pictures


class ZoneEntry(_Strict):
    """An area, m, with a speed ``limit``, m/s, closed, or to be passed along a ``path``, m."""

    kind: Literal["speed", "keep-out", "one-way"]
    area: list[Point] = Field(min_length=3)
    limit: float | None = Field(default=None, gt=0)
    path: list[Point] | None = Field(default=None, min_length=2)
    name: str = ""  # in messages and pictures


class Choose(_Strict):
    """What is marked as best "for you"."""

    preference: str  # file that `hpop prefer` wrote, relative to the scenario


class ScenarioFile(_Strict):
    """The keys of a scenario file."""

    world: WorldSection
    model: str | Named = DEFAULT_MODEL
    start: Any  # these two are the model's to check
    goal: Any
    criteria: list[str | Named] = Field(min_length=1)
    quanta: dict[str, float] = {}
    planner: str | Named | Annotated[list[str | Named], Field(min_length=1)] = DEFAULT_PLANNER
    horizon: float | None = Field(default=None, gt=0)
    people: list[Entry] = []
    groups: list[Annotated[list[int | str], Field(min_length=2)]] = []
    landmarks: list[Entry] = []
    zones: list[Entry] = []
    choose: Choose | None = None


def parameters_of(cls: Any) -> type[BaseModel]:
    """Return the form of a dataclass's fields; those that are models are given as choices."""
    hints = hints_of(cls) | dict.fromkeys(model_parameters(cls), str | dict[str, Any])
    schema: dict[str, Any] = {}
    for field in dataclasses.fields(cls):
        if field.init:
            optional = not (field.default is field.default_factory is dataclasses.MISSING)
            schema[field.name] = (hints.get(field.name, Any), None if optional else ...)
    return create_model(cls.__name__, __config__=PARAMETERS, **schema)
