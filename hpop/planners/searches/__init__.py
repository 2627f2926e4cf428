"""Searches: each runs on every graph family, with its own options."""
