"""Where `judge` was before; it is in :mod:`hpop.planners.judgement`."""

from hpop.planners.judgement import judge

__all__ = ["judge"]
