"""Fault rules: targets by name, and the schedule of a run."""
