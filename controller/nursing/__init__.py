"""Nursing: whole-body contact manipulation after Mukai et al., IROS 2011 [R11]."""
