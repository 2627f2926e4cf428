"""A criterion and a map reader that hpop finds by their entry points."""
