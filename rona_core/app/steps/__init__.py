"""The steps, declared in order: the one list of them. Each is a folder with a `step.py`."""

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.runtime.session_step import SESSION
from rona_core.app.steps.acoustics.step import STEP as ACOUSTICS
from rona_core.app.steps.boundaries.step import STEP as BOUNDARIES
from rona_core.app.steps.handheld.step import STEP as HANDHELD
from rona_core.app.steps.implant.burr.step import STEP as BURR
from rona_core.app.steps.implant.step import STEP as IMPLANT
from rona_core.app.steps.imports.step import STEP as IMPORTS
from rona_core.app.steps.maps.step import STEP as MAPS
from rona_core.app.steps.path.step import STEP as PATH
from rona_core.app.steps.pointer.step import STEP as POINTER
from rona_core.app.steps.recordings.step import STEP as RECORDINGS
from rona_core.app.steps.roll.step import STEP as ROLL
from rona_core.app.steps.scan.landmarks.step import STEP as LANDMARKS
from rona_core.app.steps.scan.step import STEP as SCAN
from rona_core.app.steps.setup.step import STEP as SETUP
from rona_core.app.steps.smoothing.step import STEP as SMOOTHING
from rona_core.app.steps.surface.step import STEP as SURFACE
from rona_core.app.steps.tool.step import STEP as TOOL

STEPS = (
    SESSION,
    SETUP,
    TOOL,
    POINTER,
    SURFACE,
    PATH,
    SMOOTHING,
    RECORDINGS,
    ROLL,
    LANDMARKS,
    SCAN,
    ACOUSTICS,
    MAPS,
    HANDHELD,
    BOUNDARIES,
    BURR,
    IMPLANT,
    IMPORTS,
)
REGISTRY.declare(STEPS)
