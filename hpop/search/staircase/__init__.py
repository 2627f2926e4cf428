"""The search "staircase": exact and fast if one of two or three costs is a small integer (:mod:`.staircase.search`)."""
