"""Scan paths: simplification within an error bound, filter, patterns, edits, densifying."""
