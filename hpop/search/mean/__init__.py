"""Exact search if one cost is a mean, the ratio of two sums, within limits on the duration (:mod:`.capped_mean`)."""
