"""A serial arm with a camera in its hand."""
