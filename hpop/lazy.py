"""Packages whose names are imported when they are first used, so that importing the package itself stays light."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from importlib import import_module
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


def library(name: str, what: str, extra: str = "tables") -> Any:
    """A library of an extra, which ``what`` needs; where it is not installed, ImportError says how to install it."""
    try:
        return import_module(name)
    except ImportError as error:
        raise ImportError(
            f"{what} needs {name}, the extra hpop[{extra}] ({error}); pip install 'hpop[{extra}]'"
        ) from None
