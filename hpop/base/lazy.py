"""Packages whose names are imported when they are first used, so that importing the package itself stays light."""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable, Collection, Mapping
from importlib import import_module
from importlib.abc import InspectLoader
from typing import Any


def on_first_use(package: str, homes: Mapping[str, str], modules: Collection[str] = ()) -> Callable[[str], Any]:
    """The ``__getattr__`` of a package: each name is imported from its home, a module, when it is first asked for.

    ``modules`` are those of the package itself that are imported in the same way.
    """

    def imported(name: str) -> Any:
        if name in modules:
            return import_module(f"{package}.{name}")
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(import_module(homes[name]), name)

    return imported


def homes_of(package: str) -> dict[str, str]:
    """The module of each name that the source of a package imports for type checkers alone, from which it is imported.

    So what is imported on first use is named once, where type checkers and editors read it too.
    """
    spec = sys.modules[package].__spec__
    source = spec.loader.get_source(package) if spec and isinstance(spec.loader, InspectLoader) else None
    if source is None:
        raise ImportError(f"{package} is there without its source, which names what it imports on first use")
    guarded = (
        node
        for node in ast.parse(source).body
        if isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"
    )
    imports = (one for node in guarded for one in node.body if isinstance(one, ast.ImportFrom))
    return {alias.asname or alias.name: str(one.module) for one in imports for alias in one.names}


def library(name: str, what: str, extra: str = "tables") -> Any:
    """A library of an extra, which ``what`` needs; where it is not installed, ImportError says how to install it."""
    try:
        return import_module(name)
    except ImportError as error:
        raise ImportError(
            f"{what} needs {name}, the extra hpop[{extra}] ({error}); pip install 'hpop[{extra}]'"
        ) from None
