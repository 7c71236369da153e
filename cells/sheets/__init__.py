"""Tactile sheets: pressure transducers, contact regions, boards, and the network of the boards."""
