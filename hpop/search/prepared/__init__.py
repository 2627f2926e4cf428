"""A graph made ready to be searched again and again, from node after node, while arcs are closed and opened."""

from hpop.search.prepared.prepared import Prepared

__all__ = ["Prepared"]
