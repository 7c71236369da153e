"""The MuJoCo body: model, actuation, elastic foundation, stimulus, teacher."""
