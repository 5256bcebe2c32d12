"""Everything around the hand: room, furniture, light, camera."""
