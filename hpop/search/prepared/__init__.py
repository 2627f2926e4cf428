"""A graph prepared for many searches to the same targets, in which arcs can be closed and opened again."""

from hpop.search.prepared.prepared import Prepared

__all__ = ["Prepared"]
