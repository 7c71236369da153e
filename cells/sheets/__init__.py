"""Tactile sheets: their transducers, regions of contact, boards, and the network of the boards."""
