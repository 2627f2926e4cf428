"""Command line program ``hpop``."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hpop.base.lazy import homes_of, on_first_use

if TYPE_CHECKING:  # imported on first use, so that `hpop --help` and usage errors answer at once
    from hpop.cli import explain as explain
    from hpop.cli import page_words as page_words
    from hpop.cli import picking as picking
    from hpop.cli import report as report
    from hpop.cli import serving as serving
    from hpop.cli import user_code as user_code
    from hpop.cli.commands import main

__all__ = ["main"]

__getattr__ = on_first_use(__name__, homes_of(__name__))
