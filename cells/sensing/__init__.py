"""Sensing of the cells: transducers, encoding, sensor faults."""
