"""The UR5 in MuJoCo: model, motion, limits, shape."""
