"""Evaluation against ground truth; no algorithm imports this."""
