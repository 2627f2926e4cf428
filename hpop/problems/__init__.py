"""Problems, their solution by planners, and the resulting fronts, verified and extended."""
