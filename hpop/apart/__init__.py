"""Readers of other programs' file formats; each file is read in a child process, with a library for its format.

Each reader is a module with a function ``extract(data, options)``, which returns a `ChildAnswer` from the bytes of a
file. Answers hold numbers and words, not worlds. The modules import little, since a process starts for each file.
"""
