"""Runs: launch and supervise processes, summary, plots."""
