"""Content of a world besides obstacles: people, landmarks and zones."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hpop.base.lazy import homes_of, on_first_use

if TYPE_CHECKING:
    from hpop.world.content.content import Content, Landmark, Person, Zone

__all__ = ["Content", "Landmark", "Person", "Zone"]

__getattr__ = on_first_use(__name__, homes_of(__name__))
