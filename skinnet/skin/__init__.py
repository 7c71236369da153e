"""Skin layout: hexagonal cell lattices, tactile sheets and their placement on bodies."""
