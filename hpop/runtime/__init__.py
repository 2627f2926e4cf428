"""Processes and limits: compiled kernels, workers, interrupts, budgets, status and the server of pages."""
