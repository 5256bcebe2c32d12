"""Things to turn and to scrub in a page."""
