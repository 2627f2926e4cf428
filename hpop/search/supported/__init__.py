"""The supported part of the front, by weighted sums: one exact shortest path for each vector of weights."""
