"""Command line program ``hpop``."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hpop.base.lazy import on_first_use

if TYPE_CHECKING:
    from hpop.cli.commands import main

__all__ = ["main"]

__getattr__ = on_first_use(__name__, {"main": "hpop.cli.commands"})
