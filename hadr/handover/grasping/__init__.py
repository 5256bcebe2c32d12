"""Grasps: candidates, collisions, rescoring by the hand."""
