"""Nursing-care manipulation with whole-body tactile feedback after Mukai et al., IROS 2011 [R11]."""
