"""Reader of floor plans that are drawn with letters in a text file."""

from pathlib import Path

import numpy as np

from hpop.errors import MapError
from hpop.world import World

WALL, FREE = "#", "."


def read(path: str | Path, *, cell: float = 0.5) -> World:
    """Read a plan of ``#`` (wall) and ``.`` (free); each letter is a square of side ``cell`` metres.

    The first line is the top one. Blank lines are skipped.
    """
    if not 0 < cell < np.inf:
        raise MapError(f"cell must be a positive length in m, got {cell!r}")
    try:
        lines = [line.strip() for line in Path(path).read_text(encoding="utf-8").splitlines() if line.strip()]
    except (OSError, UnicodeDecodeError) as error:
        raise MapError(f"cannot read the plan {str(path)!r}: {error}") from None
    if not lines or len({len(line) for line in lines}) != 1 or set("".join(lines)) - {WALL, FREE}:
        raise MapError(f"{path} must be lines of equal length of {WALL!r} and {FREE!r}")
    letters = np.array([list(line) for line in lines])  # (rows, columns), the top row first
    return World.from_cells(letters[::-1] == WALL, cell)
