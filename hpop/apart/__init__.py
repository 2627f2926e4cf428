"""What files of foreign formats hold, taken out of them in a process of its own by the libraries that know them.

A module here has ``extract(data, options)``, which gives an `Answer` out of a file's bytes. It knows numbers and words,
no worlds, and imports little, since a process starts for each file.
"""
