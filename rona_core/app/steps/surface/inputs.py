"""Inputs that results take from the surface of step 4."""

from rona_core.app.declarations.inputs import Input
from rona_core.app.dependencies.inputs import result_input
from rona_core.geometry.surface.cloud import SurfaceCloud

SURFACE: Input[SurfaceCloud] = result_input("surface")
