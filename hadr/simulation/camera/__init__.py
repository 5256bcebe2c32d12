"""The robot's camera: where it stands, what it sees, what is made of it."""
