"""Readers of foreign file formats, each run in a process of its own, with the library that knows the format.

Each module here has a function ``extract(data, options)``, which returns a `ChildAnswer` from the bytes of a file. It
returns numbers and words, not worlds, and imports little, since a process starts for each file.
"""
