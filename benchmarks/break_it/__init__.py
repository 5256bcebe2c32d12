"""How the project tries to break itself: the tables and the machinery of `break_it.py`."""
