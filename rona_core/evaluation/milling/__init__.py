"""Figures of a milling against the true bone."""
