"""Readers of foreign file formats that run in a process of their own, with the libraries that know the formats.

A module here has ``extract(data, options)``, which returns a `ChildAnswer` from a file's bytes. It knows numbers and
words, not worlds, and imports little, since a process starts for each file.
"""
