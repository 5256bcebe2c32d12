"""The frames of a training: in memory, augmented, given predicted masks and keypoints."""
