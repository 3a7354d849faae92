"""Scan paths: simplification within an error bound, filter, patterns, edits, densifying."""

from rona_core.path.densify import densify
from rona_core.path.manual_edits import edit_path
from rona_core.path.scan_patterns import raster, spiral
from rona_core.path.simplification.deviation import deviations
from rona_core.path.simplification.simplify import simplify
from rona_core.path.temporal_filter import filter_path

__all__ = [
    "densify",
    "deviations",
    "edit_path",
    "filter_path",
    "raster",
    "simplify",
    "spiral",
]
