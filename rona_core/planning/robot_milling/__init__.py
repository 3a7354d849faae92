"""Milling of a bed by a robot: what its burr is to follow, and the plan that does."""
