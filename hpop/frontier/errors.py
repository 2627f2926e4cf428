"""What a front raises where it is asked for what it cannot give.

The package knows nothing of hpop, so it has errors of its own.
"""

from __future__ import annotations


class FrontError(ValueError):
    """Fronts that cannot be joined, or a choice that means nothing."""


class UnknownColumnError(FrontError, LookupError):
    """The front has no criterion or reported value of this name."""


class FrontFileError(FrontError):
    """A front cannot be written as JSON, or a file does not hold one."""
