"""The glass objects: outlines, surfaces, signed distances."""
