"""A graph prepared for many searches to the same targets, while arcs are closed and opened."""

from hpop.search.prepared.prepared import Prepared

__all__ = ["Prepared"]
