"""Tracks: recorded or predicted places of people at times, and their files."""

from hpop.world.tracks.reading import read_tracks
from hpop.world.tracks.track import Track

__all__ = ["Track", "read_tracks"]
