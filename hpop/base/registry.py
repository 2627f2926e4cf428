"""Registries that find criteria, planners, models, goals, readers and formats by name, in hpop and in plugin packages.

Types of hpop are registered by a decorator and loaded on first use. A plugin package declares, for example::

    [project.entry-points."hpop.criteria"]
    glare = "my_package.glare:Glare"

and ``hpop.base.registry.criteria["glare"]`` finds it.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import MISSING, fields
from importlib import import_module
from importlib.metadata import entry_points
from inspect import signature
from typing import Any, Generic, TypeVar, get_type_hints
from weakref import WeakKeyDictionary

from hpop.base.text import shown
from hpop.errors import (
    CriterionError,
    HpopError,
    MapError,
    ModelError,
    OptionError,
    QueryError,
    did_you_mean,
    unknown_name,
)

T = TypeVar("T", bound=Callable[..., Any])
P = TypeVar("P")

# Groups of criteria of Becerra et al. 2020; they remind users of all aspects.
GROUPS = {"P": "performance", "C": "comfort", "R": "robot", "O": "others"}


class Registry(Mapping[str, T], Generic[T]):
    """Registry of plugin types (classes) by name, those of hpop and of plugin packages.

    kind       word for such a type in messages, such as "planner"
    module     package of hpop whose import registers hpop's own types
    group      entry-point group of plugin packages, such as "hpop.planners"
    error      class of errors for names that are taken and packages that cannot be loaded
    parameter  word for a parameter of a type in messages, such as "option"
    advice     by the name of a parameter that users may expect but no type has: what to do instead
    """

    def __init__(
        self,
        kind: str,
        module: str,
        group: str,
        error: type[HpopError],
        *,
        parameter: str = "parameter",
        advice: Mapping[str, str] | None = None,
    ) -> None:
        self.kind = kind
        self.error = error
        self.parameter = parameter
        self.advice = advice or {}
        self._module = module
        self.group = group
        self._types: dict[str, T] = {}
        self._loaded = False

    def add(self, name: str, item: T) -> None:
        """Register a type under a name; raise an error if another type has this name.

        A class of equal name and module may be registered again, as when the cell of a notebook is run again.
        """
        if name not in self._types and not item.__module__.startswith("hpop."):
            self._load_home(name)
        taken = self._types.get(name)
        if taken is not None and _origin(taken) != _origin(item):
            raise self.error(
                f"{self.kind} name {name!r} is taken by {_origin(taken)}; choose another name for {_origin(item)}"
            )
        self._types[name] = item

    def __getitem__(self, name: str) -> T:
        if not isinstance(name, str):
            raise unknown_name(self.kind, name, self)
        if name not in self._types:
            self._load_home(name)
        if name not in self._types:
            self._load_entry_points()
        if name not in self._types:
            raise unknown_name(self.kind, name, self._types)
        return self._types[name]

    def __contains__(self, name: object) -> bool:
        self._load_entry_points()
        return name in self._types

    def __iter__(self) -> Iterator[str]:
        self._load_entry_points()
        return iter(sorted(self._types))

    def __len__(self) -> int:
        self._load_entry_points()
        return len(self._types)

    def own(self) -> dict[str, T]:
        """Return, by name, the types registered so far that do not come with hpop; nothing is loaded for that."""
        return {name: item for name, item in self._types.items() if item.__module__.partition(".")[0] != "hpop"}

    def _load_home(self, name: str) -> None:
        """Import the type of hpop that has this name, if there is one.

        The class is found by its name: ``OSpace`` for "o_space", ``LatticeGraph`` for the graph "lattice".
        """
        package = import_module(self._module)
        letters = str(name).replace("-", "").replace("_", "")
        for public in getattr(package, "__all__", ()):
            if public.lower() in (letters, f"{letters}{self.kind}"):
                getattr(package, public)  # the package imports it on first use

    def _load_entry_points(self) -> None:
        """Load all types of hpop and of installed plugin packages, once."""
        if self._loaded:
            return
        package = import_module(self._module)
        for public in getattr(package, "__all__", ()):
            getattr(package, public)
        for point in entry_points(group=self.group):
            try:
                item = point.load()
            except Exception as error:
                raise self.error(
                    f"{self.kind} {point.name!r} ({point.value}) of an installed package cannot be loaded: "
                    f"{type(error).__name__}: {error}; repair or uninstall the package"
                ) from error
            self.add(point.name, item)
        self._loaded = True


def _origin(item: Any) -> str:
    """Return module and name of a type or function: "hpop.criteria.base.Criterion"."""
    return f"{item.__module__}.{item.__qualname__}"


_PRESENT = WeakKeyDictionary[type, frozenset[str]]()  # names of members that classes are known to have


def with_optional_members(plugin: P, defaults: Mapping[str, Any]) -> P:
    """Add defaults for the optional members of its protocol that a plugin lacks, and return the plugin.

    The defaults are set in the plugin's class, in place; in the instance if the class cannot be changed.

    plugin    a class or an instance
    defaults  default value of each optional member, by name; existing attributes do not change
    """
    cls: Any = plugin if isinstance(plugin, type) else type(plugin)
    if _PRESENT.get(cls, frozenset()) >= defaults.keys():
        return plugin
    for name, value in defaults.items():
        # A property of an instance may take long to compute, so the class is examined first.
        if not (name.startswith("__") or hasattr(cls, name) or hasattr(plugin, name)):
            try:
                setattr(cls, name, value)
            except TypeError:  # a class that cannot be changed, such as SimpleNamespace
                setattr(plugin, name, value)
    _PRESENT[cls] = _PRESENT.get(cls, frozenset()) | {name for name in defaults if hasattr(cls, name)}
    return plugin


criteria: Registry[type] = Registry("criterion", "hpop.criteria", "hpop.criteria", CriterionError)
FEWER_POINTS = "choose among the points of the front: front.representative(20), or hpop plan --points 20"
planners: Registry[type[Any]] = Registry(
    "planner",
    "hpop.planners",
    "hpop.planners",
    OptionError,
    parameter="option",
    advice={"max_points": FEWER_POINTS, "points": FEWER_POINTS},
)
graphs: Registry[type[Any]] = Registry("graph", "hpop.planners.graphs", "hpop.graphs", OptionError, parameter="option")
goals: Registry[type] = Registry("goal", "hpop.goals", "hpop.goals", QueryError)
IN_A_VIEW = "wrap the robot in a view: {view: {model: ..., turning: unwound, yaw: 0}}"
models: Registry[type] = Registry(
    "model", "hpop.models", "hpop.models", ModelError, advice={"view": IN_A_VIEW, "view_yaw": IN_A_VIEW}
)
readers: Registry[Callable[..., Any]] = Registry("reader", "hpop.world.readers.readers", "hpop.readers", MapError)
formats: Registry[Callable[..., Any]] = Registry("format", "hpop.export", "hpop.formats", OptionError)


def plugin_from_spec(registry: Registry[type], spec: Any) -> Any:
    """Return a new plugin object from its name, or from a dictionary ``{name: {parameter: value}}``.

    Raises UnknownName for a name that is not registered, and the registry's error for wrong parameters.
    """
    kind, error = registry.kind, registry.error
    named = {spec: None} if isinstance(spec, str) else spec
    if not isinstance(named, Mapping) or len(named) != 1:
        raise error(f"a {kind} must be given as a name, or as one name with its parameters, got {shown(spec)}")
    ((name, parameters),) = named.items()
    if not isinstance(parameters, Mapping | None):
        raise error(
            f"the parameters of {kind} {shown(name)} must be given by name, as {{name: value}}, got {shown(parameters)}"
        )
    cls = registry[name]
    check_parameters(registry, name, cls, parameters or {})
    own = model_parameters(cls) if registry is models else ()
    try:
        return cls(
            **{
                key: make_model(value) if key in own and isinstance(value, str | Mapping) else value
                for key, value in (parameters or {}).items()
            }
        )
    except TypeError as wrong:  # a missing parameter, or one of another type
        raise error(
            f"{kind} {name!r} cannot be made with the parameters {shown(dict(parameters or {}))}: {wrong}; change them"
        ) from wrong


def check_parameters(registry: Registry[type], name: str, cls: Any, given: Collection[str]) -> None:
    """Raise the registry's error if ``given`` has unknown names of parameters, or lacks required ones."""
    known = [field.name for field in fields(cls) if field.init]
    accepted = {*known, *signature(cls).parameters}  # with arguments that only set fields, such as rng
    strange = sorted(str(parameter) for parameter in given if parameter not in accepted)
    if strange:
        raise registry.error(
            f"{registry.kind} {name!r} has no {registry.parameter} {', '.join(map(shown, strange))}."
            f"{''.join(did_you_mean(parameter, known) for parameter in strange)} It has {', '.join(known) or 'none'}"
            f"{''.join(f'; {registry.advice[name]}' for name in strange if name in registry.advice)}"
        )
    if absent := [parameter for parameter in required_parameters(cls) if parameter not in given]:
        raise registry.error(
            f"{registry.kind} {name!r} also needs {', '.join(absent)}; its {registry.parameter}s are {', '.join(known)}"
        )


def required_parameters(cls: Any) -> list[str]:
    """Return the names of a dataclass's parameters without a default."""
    return [field.name for field in fields(cls) if field.init and field.default is field.default_factory is MISSING]


def hints_of(cls: Any) -> dict[str, Any]:
    """Return the types of a dataclass's fields by name; {} for a plugin that imports them for type checkers only."""
    try:
        return get_type_hints(cls, include_extras=True)
    except NameError:
        return {}


def model_parameters(cls: Any) -> frozenset[str]:
    """Return the names of a dataclass's fields that are robot models, such as the base of a pan-tilt head."""
    own = {field.name for field in fields(cls) if field.init}
    return frozenset(name for name, hint in hints_of(cls).items() if name in own and _is_model_hint(hint))


def _is_model_hint(hint: Any) -> bool:
    """Return whether the type of a field is a robot model."""
    return isinstance(hint, type) and all(hasattr(hint, name) for name in ("space", "laws", "pose", "twist"))


def make_model(spec: str | Mapping[str, Mapping[str, Any] | None]) -> Any:
    """Return the robot model of a name or ``{name: {parameter: value}}``; raise UnknownName or ModelError."""
    return plugin_from_spec(models, in_a_view(spec))


def in_a_view(spec: Any) -> Any:
    """Return a model's description without the former options ``view`` and ``view_yaw`` of a differential drive.

    Scenarios and saved fronts of earlier versions have them; an unwound view becomes the model "view" round the robot.
    """
    drive = spec.get("differential_drive") if isinstance(spec, Mapping) and len(spec) == 1 else None
    if not isinstance(drive, Mapping) or drive.get("view", "") not in ("fixed", "unwound"):
        return spec
    robot = {"differential_drive": {name: drive[name] for name in drive if name not in ("view", "view_yaw")}}
    if drive["view"] == "fixed":
        return robot
    return {"view": {"model": robot, "turning": "unwound", "yaw": drive.get("view_yaw", 0.0)}}
