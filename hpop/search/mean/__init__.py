"""Exact means under a cap: a cost that is the ratio of two sums (:mod:`.capped_mean`)."""
