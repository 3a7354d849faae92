"""Figures of merit of RONA beside those of peers and of the published procedure."""
