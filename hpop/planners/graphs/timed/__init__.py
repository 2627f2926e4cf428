"""Planning among moving people: graphs searched in time steps, with costs and blocked arcs that depend on the time."""
