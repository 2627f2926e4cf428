"""The curves of a differential drive, by the name under which they are public."""

from hpop.models.differential_drive.driven import driven

__all__ = ["driven"]
