"""Stress tests: sweeps of load through real processes."""
