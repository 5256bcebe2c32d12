"""Synthesis: hand-held glass frames with exact labels, by ray casting on the CPU."""
