"""Touch: fusion of events, reactions, posture and the safety clamp."""
