"""The explorer of a front: a page in one file, to choose a trajectory from."""
