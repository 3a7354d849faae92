"""Boundaries: the A-scans of all scans, and boundaries corrected by hand."""

from rona_core.app.declarations import declarations as declare
from rona_core.app.steps.boundaries.handlers import clear_boundary_corrections, correct_boundary
from rona_core.app.steps.boundaries.messages import ClearBoundaryCorrections, CorrectBoundary

STEP = declare.Step(
    "boundaries",
    commands=(
        declare.Command(CorrectBoundary, correct_boundary, done="a boundary was corrected by hand"),
        declare.Command(
            ClearBoundaryCorrections,
            clear_boundary_corrections,
            done="the corrections of boundaries were removed",
        ),
    ),
)
