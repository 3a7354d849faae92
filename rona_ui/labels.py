"""What the fields are called: refusals name parameters, people read the labels of fields."""

import re
from dataclasses import fields

from rona_core.app.messages import ACTIVITIES, COMMANDS

UNITS = {
    "mm_per_us": "mm/µs", "mm_per_s": "mm/s", "mm": "mm", "deg": "deg", "s": "s", "ms": "ms",
    "us": "µs", "db": "dB", "mhz": "MHz", "hz": "Hz", "n": "N", "c": "°C",
}  # fmt: skip
# fields that stand alone, outside of the forms
OTHERS = {
    "sound_speed_mm_per_us": "Bone (mm/µs)",
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


def in_words(text: str) -> str:
    """Return a message with the labels of fields in place of the names of parameters."""
    told = re.sub(
        r"\b[a-z][a-z0-9]*(?:_[a-z0-9]+)+\b",
        lambda found: label_of(found[0]) if found[0] in NAMES else found[0],
        text,
    )
    return told if told == text else told[:1].upper() + told[1:]
