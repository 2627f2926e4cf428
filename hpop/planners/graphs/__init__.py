"""Graphs of states that any search takes: their costs, exact ends, the query, and what is claimed of its answer."""
