"""Boundaries: the A-scans of all scans, and boundaries corrected by hand."""

from rona_core.app.declarations.declarations import Command, Step
from rona_core.app.steps.boundaries.handlers import clear_boundary_corrections, correct_boundary
from rona_core.app.steps.boundaries.messages import ClearBoundaryCorrections, CorrectBoundary

STEP = Step(
    "boundaries",
    commands=(
        Command(CorrectBoundary, correct_boundary),
        Command(ClearBoundaryCorrections, clear_boundary_corrections),
    ),
)
