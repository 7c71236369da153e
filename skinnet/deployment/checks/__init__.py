"""Checks across the keys of a deployment that no schema can express."""
