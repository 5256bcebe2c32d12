"""How sure a network is of its answer, and on which frames that holds."""
