"""Benchmark of robots that are not ours: from a model's file to skin, structure, map and reactions."""
