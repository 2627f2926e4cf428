"""Names of criteria, planners, models and readers: a decorator at home, an entry point abroad, loaded on first use.

A plugin package declares, for example::

    [project.entry-points."hpop.criteria"]
    glare = "my_package.glare:Glare"

and ``hpop.registry.criteria["glare"]`` finds it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields
from importlib import import_module
from importlib.metadata import entry_points
from typing import Any, Generic, TypeVar

from hpop.errors import CriterionError, HpopError, MapError, ModelError, OptionError, unknown_name

T = TypeVar("T", bound=Callable[..., Any])

# The paper's groups of criteria, so that no aspect is forgotten (Becerra et al. 2020).
GROUPS = {"P": "performance", "C": "comfort", "R": "robot", "O": "others"}


class Registry(Mapping[str, T], Generic[T]):
    """Types by name; importing ``module`` registers those at home, entry points of ``group`` those abroad.

    A name taken twice and a package that cannot be loaded raise ``error``.
    """

    def __init__(self, kind: str, module: str, group: str, error: type[HpopError]) -> None:
        self.kind = kind
        self._error = error
        self._module = module
        self._group = group
        self._types: dict[str, T] = {}
        self._loaded = False

    def add(self, name: str, item: T) -> None:
        """Register a type; a name that another type has is an error (a notebook may define the same class again)."""
        taken = self._types.get(name)
        if taken is not None and _origin(taken) != _origin(item):
            raise self._error(
                f"{self.kind} name {name!r} is taken by {_origin(taken)}; choose another for {_origin(item)}"
            )
        self._types[name] = item

    def __getitem__(self, name: str) -> T:
        if name not in self._types:
            self._load()
        if name not in self._types:
            raise unknown_name(self.kind, name, self._types)
        return self._types[name]

    def __contains__(self, name: object) -> bool:
        self._load()
        return name in self._types

    def __iter__(self) -> Iterator[str]:
        self._load()
        return iter(sorted(self._types))

    def __len__(self) -> int:
        self._load()
        return len(self._types)

    def _load(self) -> None:
        if self._loaded:
            return
        import_module(self._module)
        for point in entry_points(group=self._group):
            try:
                item = point.load()
            except Exception as error:
                raise self._error(
                    f"{self.kind} {point.name!r} ({point.value}) of an installed package cannot be loaded: "
                    f"{type(error).__name__}: {error}; mend or uninstall that package"
                ) from error
            self.add(point.name, item)
        self._loaded = True


def _origin(item: Any) -> str:
    """Where a type or function is defined: module and name."""
    return f"{item.__module__}.{item.__qualname__}"


criteria: Registry[type] = Registry("criterion", "hpop.criteria", "hpop.criteria", CriterionError)
planners: Registry[type] = Registry("planner", "hpop.planners", "hpop.planners", OptionError)
models: Registry[type] = Registry("model", "hpop.models", "hpop.models", ModelError)
readers: Registry[Callable[..., Any]] = Registry("reader", "hpop.world.readers", "hpop.readers", MapError)


def make_model(spec: Mapping[str, Mapping[str, Any]]) -> Any:
    """A model from ``{name: {parameter: value}}``; UnknownName or ModelError where that makes no sense."""
    if not isinstance(spec, Mapping) or len(spec) != 1:
        raise ModelError(f"a model is given as one name with its parameters, got {spec!r}")
    ((name, parameters),) = spec.items()
    if not isinstance(parameters, Mapping | None):
        raise ModelError(f"the parameters of model {name!r} are given by name, got {parameters!r}")
    cls = models[name]
    known = [field.name for field in fields(cls)]
    strange = sorted(set(parameters or {}) - set(known))
    if strange:
        raise ModelError(f"model {name!r} has no parameter {', '.join(map(str, strange))}; it has {', '.join(known)}")
    return cls(**(parameters or {}))
