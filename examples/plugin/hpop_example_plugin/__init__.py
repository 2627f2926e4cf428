"""A criterion, a robot and a map reader that hpop finds by their entry points."""
