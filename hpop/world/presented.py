"""What prompts and notebooks show of a world."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

from hpop.base.table import facts_html, picture_html

if TYPE_CHECKING:
    from hpop.world.world import World


class Presented:
    """A line for a prompt; a table and a picture for a notebook."""

    def __repr__(self) -> str:
        from hpop.world.description import summary

        return summary(cast("World", self))

    def _repr_html_(self) -> str:
        from hpop.world.description import facts

        world = cast("World", self)
        notes = [(f"note {number}", note) for number, note in enumerate(world.notes, 1)]
        return facts_html([*facts(world).items(), *notes]) + picture_html(world)
