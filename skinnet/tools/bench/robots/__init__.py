"""Benchmark of robots that are not ours: from the model's file to skin, map and reactions, as a user would go."""
