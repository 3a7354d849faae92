"""Implants as data: their solids, screws, and where each of their dimensions comes from."""
