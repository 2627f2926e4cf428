"""Speed profiles along a given path: convex programs in the square of the speed."""
