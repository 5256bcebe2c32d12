"""Surfaces painted by rule."""
