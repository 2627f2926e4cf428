"""Plans among people who move: graphs of states with a clock, so that costs and free ways depend on the time."""
