"""Stages of the controller's program."""
