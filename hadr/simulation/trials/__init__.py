"""Attempts at the handover: one, many, rehearsed without physics; and which there are."""

TRIAL_OBJECTS: tuple[str, ...] = ("0000", "0001", "0004", "0006", "0008", "0010", "0011", "0012")
"""The eight objects of the experiment; the last three are novel shapes."""
TRIAL_HOLDS: tuple[int, ...] = (900, 901, 902, 903, 904, 905)
"""Holding poses of the 48 attempts. All else uses other numbers: TransHand-mini those up to 320,
the training, validation and test frames of the camera beside the robot
(`hadr.simulation.camera.training_frames`) 400 to 679, the search for the attempts' settings 920 and
on."""
