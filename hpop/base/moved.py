"""Modules that had other names: they are imported under these too, with a warning."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Sequence
from functools import partial
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType

MOVED = {
    "hpop.arrays": "hpop.base.arrays",
    "hpop.front": "hpop.problems.front",
    "hpop.history": "hpop.trajectories.history",
    "hpop.math": "hpop.base.math",
    "hpop.named_rows": "hpop.problems.named_rows",
    "hpop.options": "hpop.base.options",
    "hpop.poses": "hpop.trajectories.poses",
    "hpop.problem": "hpop.problems.problem",
    "hpop.randomness": "hpop.base.randomness",
    "hpop.registry": "hpop.base.registry",
    "hpop.status": "hpop.runtime.status",
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
    """Finds a module by its former name, when no module has that name now."""

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return where a former name leads; None for other names."""
        return ModuleSpec(name, self) if name in MOVED else None

    def exec_module(self, module: ModuleType) -> None:
        """Give a module the names of the one that replaced it."""
        replacement = MOVED[module.__name__]
        warnings.warn(f"{module.__name__} is {replacement} now", DeprecationWarning, stacklevel=2)
        module.__getattr__ = partial(getattr, import_module(replacement))  # type: ignore[method-assign]


def find_former_names() -> None:
    """Let modules be imported by their former names, when nothing else has these."""
    if not any(isinstance(finder, _FormerNames) for finder in sys.meta_path):
        sys.meta_path.append(_FormerNames())
