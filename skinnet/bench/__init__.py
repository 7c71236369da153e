"""Benchmarks of the simulator against others, in one run."""
