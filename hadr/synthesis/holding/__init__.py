"""How a hand comes to hold a glass."""
