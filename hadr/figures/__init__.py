"""Every figure of the book: `panels` has its style and the panels that most of them share."""
