"""J_O: people near the robot. Criteria of this group need people in the world."""
