"""The simulated world: held glass, moving hand, physics, judge."""
