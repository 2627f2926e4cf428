"""hpop: human perception-optimized planning. See README.md."""
