"""Open benchmark of multi-objective shortest paths: graphs as text, fronts as hashes, and runs of any program."""
