"""J_P: the system keeps its intended function. The camera sees, orientation and presence are kept."""
