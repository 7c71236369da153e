"""Covering: cells of skin laid over the surface of a robot's links, wired, and joined to its computer."""
