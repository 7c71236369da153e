"""Specs of the environment: teacher, stand, objects, payload, scripted stimuli."""
