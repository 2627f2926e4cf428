"""The search "general": exact, for one to six costs on any graph (:mod:`.general.search`)."""
