"""Explorer of a front: a web page in one file, on which a person chooses a trajectory."""
