"""Specs of an experiment: faults, memory, link budget, stress sweep."""
