"""Import of the user's own Python code, named on the command line, before a scenario or a front is read.

Scenarios and fronts themselves run no code. A file is imported under its own name, with its folder on the import path,
so that worker processes and pickles find it.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import is_dataclass
from importlib import import_module, invalidate_caches
from importlib.metadata import entry_points
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

from hpop.base.registry import (
    Registry,
    criteria,
    formats,
    goals,
    graphs,
    models,
    planners,
    readers,
    required_parameters,
)
from hpop.base.text import shown, some
from hpop.criteria.base import Criterion, make_criterion
from hpop.errors import CriterionError, HpopError, OwnCodeError, UnknownName, did_you_mean, own_location
from hpop.motions import Model
from hpop.planners.base import Planner, make_planner

REGISTRIES: tuple[Registry[Any], ...] = (criteria, planners, graphs, models, goals, readers, formats)
HOME = Path(__file__).parents[1]
"""Folder of the package hpop."""
FIRST = ("hpop.cli.report", "hpop.scenario")
"""Modules that import the libraries."""
FORM = "give FILE.py, or a MODULE that Python can import from the current folder"


def register(specs: Iterable[str]) -> None:
    """Import files (``FILE.py``) and modules that register criteria, planners, graphs or other plugins of hpop.

    Raises OwnCodeError if one cannot be imported or registers nothing. An invalid declaration, or a name that is taken,
    raises the error of its registry, with file and line.
    """
    for spec in dict.fromkeys(specs):
        before, module = list(_registered()), imported(spec)
        inside = f"{module.__name__}."
        if not any(item not in before or f"{item.__module__}.".startswith(inside) for item in _registered()):
            raise OwnCodeError(
                f"{spec} ({getattr(module, '__file__', None) or 'no file'}) registers no criterion, planner, graph, "
                "model, goal, reader or format; declare one, such as a class with @hpop.criterion"
            )
    for registry in REGISTRIES:
        own = registry.own()
        if own and any(point.name in own for point in entry_points(group=registry.group)):
            len(registry)  # loads installed packages, which reports names that are taken


def _registered() -> Iterator[Any]:
    """Yield all registered classes that are not part of hpop."""
    for registry in REGISTRIES:
        yield from registry.own().values()


def named(spec: str) -> Criterion | Model | Planner:
    """Return a criterion, model or planner with default parameters, named by ``FILE.py:NAME``, ``MODULE:NAME`` or name.

    Raises OwnCodeError if its module cannot be imported, CriterionError if the module has no such class, and
    UnknownName for a name that is not registered.
    """
    source, colon, name = spec.rpartition(":")
    known = {name: registry[name] for registry in (planners, models, criteria) for name in registry}
    if not colon and spec not in known:
        if _is_file(spec):
            raise CriterionError(f"{spec!r} names only a file: give {spec}:NAME, with the class to check")
        raise _unregistered(spec, known)
    try:
        found: Any = _named_in(imported(source), name) if colon else known[spec]
    except AttributeError as error:
        near = did_you_mean(name, vars(imported(source)))
        raise CriterionError(f"{spec!r} does not exist ({error}); give FILE.py:NAME or MODULE:NAME.{near}") from None
    try:
        made = found() if isinstance(found, type) else found
    except TypeError as error:
        absent = ", ".join(required_parameters(found)) if is_dataclass(found) else ""
        why = f"there is none for {absent}" if absent else str(error)
        kind = next((registry.error for registry in (planners, models) if found in registry.values()), CriterionError)
        raise kind(
            f"{spec} can be checked by its name only if all its parameters have defaults: {why}. Create one in a file, "
            f"such as mine = {getattr(found, '__name__', spec)}(...), and give FILE.py:mine"
        ) from None
    if isinstance(made, Model):
        return made
    return make_planner(made) if callable(getattr(made, "solve", None)) else make_criterion(made)


def _unregistered(spec: str, known: Mapping[str, Any]) -> UnknownName:
    """Return the error for a name that is not registered, with advice on how to register or name the class."""
    packages = ("criteria", "planners", "models")
    home = [file for package in packages for file in HOME.glob(f"{package}/**/*.py") if file.stem == spec]
    if os.path.isfile(f"{spec}.py"):
        way_out = f"{spec}.py is in this folder: give {spec}.py:NAME, where NAME is the class or its registered name"
    elif home and spec.isidentifier():
        package = home[0].relative_to(HOME).parts[0]
        way_out = (
            f"{home[0]} exists, but hpop.{package} does not import it: add its class to the imports of "
            f"{HOME / package}/__init__.py"
        )
    else:
        way_out = "for a class of your own, give FILE.py:NAME, or its name with --import FILE.py"
        if own := [
            name for name, thing in known.items() if str(getattr(thing, "__module__", "")).partition(".")[0] != "hpop"
        ]:
            way_out = f"your own are {some(own)}; {way_out}"
    return UnknownName(
        f"no criterion, model or planner called {shown(spec)} is imported.{did_you_mean(spec, known)} `hpop criteria`, "
        f"`hpop models` and `hpop planners` list what there is; {way_out}"
    )


def _named_in(module: ModuleType, name: str) -> Any:
    """Return an attribute of a module by its name, or a type that the module has registered under that name."""
    if not hasattr(module, name):
        for registry in REGISTRIES:
            item = registry.own().get(name)
            if item is not None and item.__module__ == module.__name__:
                return item
    return getattr(module, name)


def imported(spec: str) -> ModuleType:
    """Import a ``FILE.py``, or a module by its dotted name as seen from the current folder, and return it.

    Raises OwnCodeError; an HpopError that the code itself raises keeps its type, and gets file and line.
    """
    source, _, name = spec.rpartition(":")
    if source and name.isidentifier():
        raise OwnCodeError(f"cannot import {spec!r}: a file or module is imported as a whole; give {source}")
    is_file = _is_file(spec)
    if not is_file:
        _look_in(Path.cwd())
    try:
        return import_module(_placed(Path(spec)) if is_file else spec)
    except OwnCodeError:
        raise
    except (Exception, SystemExit) as error:  # whatever the user's code does
        raise _reported(error, spec, is_file=is_file) from error


def _is_file(spec: str) -> bool:
    """Return whether a spec names a file or folder rather than a module."""
    path_like = spec.endswith(".py") or spec.startswith(".") or "/" in spec or os.sep in spec
    return path_like or ("." in spec and os.path.isfile(spec))


def _placed(file: Path) -> str:
    """Put the folder of a file on the import path, and return the name under which the file can be imported.

    Workers and pickles find a module by its name, so no other module may have this name.
    """
    if os.path.isdir(file):
        raise OwnCodeError(
            f"cannot import {str(file)!r}: it is a folder; give a file in it, such as {file / 'NAME.py'}, or a MODULE "
            "that Python can import from the current folder"
        )
    if not os.path.isfile(file):
        raise OwnCodeError(f"cannot import {str(file)!r}: there is no such file; {FORM}")
    name = file.stem
    if file.suffix != ".py" or "." in name:
        raise OwnCodeError(f"cannot import {str(file)!r}: rename it to NAME.py, with no other dot in its name")
    _only(name, file)
    _look_in(file.absolute().parent)
    _only(name, file)
    return name


def _only(name: str, file: Path) -> None:
    """Raise OwnCodeError if Python would import another module under the name of this file."""
    try:
        found = find_spec(name)
    except ValueError:  # __main__ and other modules without an origin
        other = "part of Python"
    else:
        if found is None or found.origin is None:  # a plain folder gives way to a file
            return
        if found.has_location and file.resolve() == Path(found.origin).resolve():
            return
        other = found.origin
    raise OwnCodeError(
        f"cannot import {str(file)!r}: its name is taken by the module {name!r} ({other}), which Python would find "
        "instead; rename the file"
    )


def _look_in(folder: Path) -> None:
    """Put a folder first on the import path, as Python does for scripts.

    Libraries that hpop needs are imported before, because the folder may have files with their names.
    """
    for module in FIRST:
        import_module(module)
    if str(folder) not in sys.path:
        sys.path.insert(0, str(folder))
    invalidate_caches()


def _reported(error: BaseException, spec: str, *, is_file: bool) -> HpopError:
    """Return the error to report for an error in imported code; errors of hpop keep their type."""
    place = own_location(error)
    if isinstance(error, HpopError):
        return type(error)(f"{place or spec}: {error}")
    text = error.msg if isinstance(error, SyntaxError) else str(error)
    what = ": ".join(part for part in (place, type(error).__name__, text) if part)
    if isinstance(error, SystemExit):
        way_out = "; put code that runs it as a program below if __name__ == '__main__'"
    elif isinstance(error, ImportError) and "relative import" in text:
        way_out = "; the file is part of a package: give PACKAGE.MODULE, as imported from the current folder"
    else:
        way_out = "" if place or is_file else f"; {FORM}"
    return OwnCodeError(f"cannot import {spec!r}: {what}{way_out}")
