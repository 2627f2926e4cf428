"""Tracks: where people are at which time, and the files that say so."""

from hpop.world.tracks.reading import read_tracks
from hpop.world.tracks.track import Track

__all__ = ["Track", "read_tracks"]
