"""Body simulation on MuJoCo: model, servos, skin contact, stimulus, teacher, ground truth."""
