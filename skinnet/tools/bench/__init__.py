"""Benchmarks of the packet kernel against other simulators."""
