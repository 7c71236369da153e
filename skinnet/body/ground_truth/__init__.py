"""Ground truth of a run, for metrics and tests, never for control."""
