"""Data path of the cells: packets, wiring, link faults, outages."""
