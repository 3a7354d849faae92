"""Panels of the docks: steps, fields, figures, graphs."""
