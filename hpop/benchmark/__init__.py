"""Open benchmark of multi-objective shortest paths: graphs as text files, hashes of fronts, runs of any program."""
