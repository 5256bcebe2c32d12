"""What turns notebooks and results into the book."""
