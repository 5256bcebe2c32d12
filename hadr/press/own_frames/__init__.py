"""What users make of their own frames: `hadr restore` and `hadr view`."""
