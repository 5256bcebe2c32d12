"""Attempts at a handover, one or a table of them."""
