"""Pictures of frames and of what corrupts their depth."""
