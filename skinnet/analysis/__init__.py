"""Analysis of a run: metrics, plots, report."""
