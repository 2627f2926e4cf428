"""What the searches share: labels, slices of time, bounds, groups that turns make, checkpoints, approximation."""
