"""Scan paths: smoothing with a bound on the deviation, interpolation, coverage."""
