"""Readers of maps, mostly one module per format, and the registry of readers by name."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hpop.base.lazy import homes_of, on_first_use

if TYPE_CHECKING:
    from hpop.world.readers.readers import read_world

__all__ = ["read_world"]

__getattr__ = on_first_use(__name__, homes_of(__name__))
