"""Recordings: captures of the pointer that were made elsewhere."""

from rona_core.app.declarations.declarations import Activity, Step
from rona_core.app.steps.recordings.captures import (
    require_as_recorded,
    store_pivot,
    store_recording,
)
from rona_core.app.steps.recordings.messages import StartPivotImport, StartRecordingImport

STEP = Step(
    "recordings",
    activities=(
        Activity(
            StartRecordingImport,
            store_recording,
            "Reading the recording",
            check=require_as_recorded,
            uses_devices=True,
            records=True,
            of_several_steps=True,
        ),
        Activity(
            StartPivotImport,
            store_pivot,
            "Reading the pivot",
            uses_devices=True,
            records=True,
            shown_in="pointer",
        ),
    ),
)
