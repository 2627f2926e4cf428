"""Tracks: recorded or predicted positions of people over time, and their files."""

from hpop.world.tracks.reading import read_tracks
from hpop.world.tracks.track import Track

__all__ = ["Track", "read_tracks"]
