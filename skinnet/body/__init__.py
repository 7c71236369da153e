"""Body simulation on MuJoCo: model, servos, skin contact, stimulus, teacher, ground truth."""

import skinnet.mujoco_loading  # noqa: F401 -- before MuJoCo, which may lack its renderer
