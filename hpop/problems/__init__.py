"""Problems, how planners solve them, and the fronts that come of it, verified and extended."""
