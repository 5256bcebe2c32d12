"""From a recipe to frames on disk."""
