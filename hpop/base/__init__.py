"""Building blocks that know nothing of robots: arrays, numbers, text, options, registries."""
