"""Skulls from files: reading them, choosing where to scan, and the bone as a smooth distance."""
