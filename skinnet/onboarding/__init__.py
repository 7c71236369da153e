"""Onboarding of a robot: from its model file to a commented deployment that runs."""
