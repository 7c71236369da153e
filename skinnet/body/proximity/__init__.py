"""Proximity: the nearest point of solids within the field of view of a cell."""
