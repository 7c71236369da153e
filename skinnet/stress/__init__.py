"""Load tests through real processes."""
