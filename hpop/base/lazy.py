"""Lazy imports: names and modules that are imported on first use, and names and modules under their former names."""

from __future__ import annotations

import ast
import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from importlib import import_module
from importlib.abc import InspectLoader, Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any


def on_first_use(
    package: str, homes: Mapping[str, str], former: Mapping[str, str] | None = None
) -> Callable[[str], Any]:
    """Return a function for ``__getattr__`` of a package that imports each public name when it is first used.

    homes   for each name, the module that defines it, as returned by :func:`homes_of`; "" if the name is itself a
            submodule of the package
    former  for each deprecated name, the new name of its object; the deprecated one works, with a DeprecationWarning
    """

    def imported(name: str) -> Any:
        if former and name in former:
            warnings.warn(
                f"{package}.{name} is {package}.{former[name]} now; use this name", DeprecationWarning, stacklevel=2
            )
            return getattr(sys.modules[package], former[name])
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(import_module(homes[name]), name) if homes[name] else import_module(f"{package}.{name}")

    return imported


def homes_of(package: str) -> dict[str, str]:
    """Return the names that a package imports for type checkers only, each with its module as the value.

    These imports, under ``if TYPE_CHECKING``, are read from the package's source. So each name that is imported on
    first use is listed once, where type checkers and editors read it too. The value is "" if the name is itself a
    module of the package (``from package import name``).
    """
    spec = sys.modules[package].__spec__
    source = spec.loader.get_source(package) if spec and isinstance(spec.loader, InspectLoader) else None
    if source is None:
        raise ImportError(
            f"{package} needs its source file, from which its names are read, but it is missing; install hpop again"
        )
    guarded = (
        node
        for node in ast.parse(source).body
        if isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"
    )
    imports = (line for node in guarded for line in node.body if isinstance(line, ast.ImportFrom))
    homes = ((alias.asname or alias.name, str(line.module)) for line in imports for alias in line.names)
    return {name: "" if home == package else home for name, home in homes}


def library(name: str, what: str, extra: str = "tables") -> Any:
    """Import an optional library; if it is missing, raise ImportError that says how to install it.

    what   name of the feature that needs the library, for the message
    extra  hpop's extra that installs the library
    """
    try:
        return import_module(name)
    except ImportError as error:
        raise ImportError(
            f"{what} needs {name}, which cannot be imported ({error}); run pip install 'hpop[{extra}]'"
        ) from None


MOVED = {
    "hpop.arrays": "hpop.base.arrays",
    "hpop.criteria.comfort.svc": "hpop.criteria.comfort.sickness",
    "hpop.front": "hpop.problems.front",
    "hpop.history": "hpop.trajectories.history",
    "hpop.math": "hpop.base.math",
    "hpop.named_rows": "hpop.problems.named_rows",
    "hpop.options": "hpop.base.options",
    "hpop.poses": "hpop.trajectories.poses",
    "hpop.planners.lattice": "hpop.planners.graph_planners",
    "hpop.planners.roadmap": "hpop.planners.graph_planners",
    "hpop.problem": "hpop.problems.problem",
    "hpop.randomness": "hpop.base.randomness",
    "hpop.registry": "hpop.base.registry",
    "hpop.runtime.status": "hpop.runtime.limits",
    "hpop.status": "hpop.runtime.limits",
    "hpop.sweep": "hpop.runtime.sweep",
    "hpop.trajectory": "hpop.trajectories.trajectory",
    "hpop.verify": "hpop.problems.verify",
    "hpop.world.bearings": "hpop.world.sight.bearings",
    "hpop.world.field": "hpop.world.fields.field",
    "hpop.world.geojson_content": "hpop.world.readers.geojson_content",
    "hpop.world.predictions": "hpop.world.content.predictions",
    "hpop.world.proxemics": "hpop.world.content.proxemics",
    "hpop.world.visibility": "hpop.world.sight.visibility",
}


class _FormerNames(MetaPathFinder, Loader):
    """Import hook that finds modules by the names that they had in earlier versions."""

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return the import spec of a module with a former name; None for other names."""
        return ModuleSpec(name, self) if name in MOVED else None

    def exec_module(self, module: ModuleType) -> None:
        """Let a module with a former name get its attributes from the module that replaces it."""
        replacement = MOVED[module.__name__]
        warnings.warn(f"{module.__name__} is {replacement} now", DeprecationWarning, stacklevel=2)
        module.__getattr__ = partial(getattr, import_module(replacement))  # type: ignore[method-assign]


def find_former_names() -> None:
    """Install the import hook for former names of modules, once."""
    if not any(isinstance(finder, _FormerNames) for finder in sys.meta_path):
        sys.meta_path.append(_FormerNames())
