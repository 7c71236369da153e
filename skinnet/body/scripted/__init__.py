"""Scripted body: stimuli without physics."""
