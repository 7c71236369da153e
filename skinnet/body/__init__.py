"""Body simulation on MuJoCo: model, servos, skin contact, stimulus, teacher, ground truth."""

from skinnet.mujoco_loading import load_mujoco

load_mujoco()
