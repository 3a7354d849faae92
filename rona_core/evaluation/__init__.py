"""Figures against ground truth; no algorithm imports this."""
