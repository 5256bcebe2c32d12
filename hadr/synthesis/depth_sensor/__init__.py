"""A stereo depth camera with a dot projector."""
