"""Self-organisation by self-exploration: kinematic structure and sensory-motor map [M14, III]."""
