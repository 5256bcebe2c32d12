"""Recorded holding poses: files, motion, gloves."""
