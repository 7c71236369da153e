"""HTML report of a run in one file: metrics, plots, and comparison with published values."""
