"""The supported part of the front: one exact shortest path a weight (:mod:`.supported_paths`)."""
