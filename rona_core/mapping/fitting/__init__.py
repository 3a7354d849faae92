"""Fitting of a surface to scattered heights: outliers, a plate, and how sure it is."""
