"""Nursing-care manipulation with whole-body tactile feedback after Mukai et al., IROS 2011 [R11]."""

from skinnet.mujoco_loading import load_mujoco

load_mujoco()
