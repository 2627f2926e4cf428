"""The supported part of the front: one exact shortest path per weight (:mod:`.supported_paths`)."""
