"""What fields and activities are called: programs name parameters, people read labels."""

import re
from dataclasses import fields

from rona_core.app.messages.registry import ACTIVITIES, COMMANDS
from rona_core.app.overview.step_states import TITLES
from rona_core.session.document import STEPS

UNITS = {
    "mm_per_us": "mm/µs", "mm_per_s": "mm/s", "mm": "mm", "deg": "deg", "s": "s", "ms": "ms",
    "us": "µs", "db": "dB", "mhz": "MHz", "hz": "Hz", "n": "N", "c": "°C",
}  # fmt: skip
# what goes on while an activity runs
DOING = {
    "StartSkullImport": "Reading the skull",
    "StartToolCapture": "Moving the tool",
    "StartPointerCapture": "Pivoting the pointer",
    "StartSurfaceCapture": "Sliding over the skull",
    "StartSkullRegistration": "Laying the points onto the skull",
    "StartPathCapture": "Demonstrating the path",
    "StartRecordingImport": "Reading the recording",
    "StartPivotImport": "Reading the pivot",
    "StartRollSearch": "Searching the roll",
    "StartBasePlacement": "Looking for places of the base",
    "StartScan": "Scanning",
    "StartGapPlan": "Planning the second pass",
    "StartGapScan": "Scanning the gaps",
    "StartMapping": "Mapping the boundaries",
    "StartCaliperMeasurements": "Measuring with a caliper",
    "StartDelayLineCapture": "Shooting the block",
    "StartProbeSweep": "Trying other probes",
    "StartHandheldCalibration": "Calibrating the SonoPointer",
    "StartHandheldScan": "Scanning by hand",
    "StartHandheldMapping": "Mapping the scan by hand",
    "StartReplay": "Computing all results again",
    "StartRobotMove": "Moving the robot",
    "StartRetract": "Drawing the probe back",
}
# step that an activity belongs to; a recording may belong to several
STEP_OF = {
    "StartSkullImport": "setup",
    "StartDelayLineCapture": "setup",
    "StartProbeSweep": "setup",
    "StartToolCapture": "tool",
    "StartPointerCapture": "pointer",
    "StartPivotImport": "pointer",
    "StartSurfaceCapture": "surface",
    "StartSkullRegistration": "surface",
    "StartPathCapture": "path",
    "StartRollSearch": "roll",
    "StartBasePlacement": "roll",
    "StartRobotMove": "roll",
    "StartScan": "scan",
    "StartRetract": "scan",
    "StartGapPlan": "maps",
    "StartGapScan": "maps",
    "StartMapping": "maps",
    "StartCaliperMeasurements": "maps",
    "StartHandheldCalibration": "maps",
    "StartHandheldScan": "maps",
    "StartHandheldMapping": "maps",
}
# fields that stand alone, outside of the forms
OTHERS = {
    "sound_speed_mm_per_us": "Sound speed (mm/µs)",
    "thickness_mm": "Thickness (mm)",
    "snr_db": "SNR (dB)",
}
NAMES = frozenset(
    part.name
    for kind in (*COMMANDS.values(), *ACTIVITIES.values())
    for part in fields(kind)
    if "_" in part.name
)
_LABELS: dict[str, set[str]] = {name: {label} for name, label in OTHERS.items()}


def note_label(name: str, label: str) -> None:
    """Remember what the field of a parameter is called."""
    _LABELS.setdefault(name, set()).add(label)


def label_of(name: str) -> str:
    """Return what people read for a parameter: its field's label, else its name in words."""
    known = _LABELS.get(name, set())
    if len(known) == 1:
        return next(iter(known))
    for suffix, unit in UNITS.items():
        if name.endswith(f"_{suffix}"):
            return f"{name.removesuffix(f'_{suffix}').replace('_', ' ')} ({unit})"
    return name.replace("_", " ")


def doing(activity: str) -> str:
    """Return what people read while an activity runs."""
    return DOING.get(activity, activity)


def place_of(step: str | None, activity: str | None = None) -> str:
    """Return where something happened: number and title of a step, and what was going on."""
    step = STEP_OF.get(activity or "", step)
    words = [] if step is None else [f"{STEPS.index(step) + 1} {TITLES[step]}"]
    return ", ".join(words if activity is None else [*words, doing(activity)])


def in_words(text: str) -> str:
    """Return a message with the labels of fields in place of the names of parameters."""
    told = re.sub(
        r"\b[a-z][a-z0-9]*(?:_[a-z0-9]+)+\b",
        lambda found: label_of(found[0]) if found[0] in NAMES else found[0],
        text,
    )
    return told if told == text else told[:1].upper() + told[1:]
