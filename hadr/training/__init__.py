"""Training and evaluation of the depth restoration network."""
