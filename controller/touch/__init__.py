"""Tactile state, tactile reactions, posture control and safety clamp."""
