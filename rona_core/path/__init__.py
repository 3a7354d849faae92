"""Scan paths: simplification within an error bound, filter, patterns, edits, densifying."""

from rona_core.path.manual_edits import edit_path
from rona_core.path.path_samples import densify, filter_path
from rona_core.path.scan_patterns import raster, spiral
from rona_core.path.simplification.error_bound import deviations
from rona_core.path.simplification.simplify import simplify

__all__ = [
    "densify",
    "deviations",
    "edit_path",
    "filter_path",
    "raster",
    "simplify",
    "spiral",
]
