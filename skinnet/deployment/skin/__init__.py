"""Specs of the skin: tactile sheets and their boards."""
