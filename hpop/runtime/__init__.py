"""Running searches: compiled kernels, worker processes, Ctrl-C, limits, progress, and the server of web pages."""
