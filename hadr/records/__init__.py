"""What is kept of a run: results with checksums, provenance, folders, caches."""
