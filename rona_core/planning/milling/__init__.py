"""Milling of a bed: burrs, the path along concentric layers, what it removes, and its files."""
