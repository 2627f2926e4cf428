"""Tracks: where people are at which time, and the files that say so."""

from hpop.world.tracks.track import Track

__all__ = ["Track"]
