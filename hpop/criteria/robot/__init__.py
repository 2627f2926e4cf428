"""J_R: quality of the robot's motion."""
