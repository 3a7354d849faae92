"""Labels: maps names of parameters and activities to the words shown in the interface."""

import re
from dataclasses import fields

from rona_core.app.declarations.registry import REGISTRY

UNITS = {
    "mm_per_us": "mm/µs", "mm_per_s": "mm/s", "mm": "mm", "deg": "deg", "s": "s", "ms": "ms",
    "us": "µs", "db": "dB", "mhz": "MHz", "hz": "Hz", "n": "N", "c": "°C",
}  # fmt: skip
# fields that stand alone, outside of the forms
OTHERS = {
    "sound_speed_mm_per_us": "Sound speed (mm/µs)",
    "thickness_mm": "Thickness (mm)",
    "snr_db": "SNR (dB)",
}
_LABELS: dict[str, set[str]] = {name: {label} for name, label in OTHERS.items()}


def parameter_names() -> frozenset[str]:
    """Return the names of several words that parameters of messages have."""
    kinds = REGISTRY.messages.values()
    return frozenset(part.name for kind in kinds for part in fields(kind) if "_" in part.name)


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
    declared = REGISTRY.activities.get(activity)
    return activity if declared is None else declared.doing


def place_of(step: str | None, activity: str | None = None) -> str:
    """Return where something happened: number and title of a step, and what was going on."""
    step = REGISTRY.shown_in(activity or "") or step
    words = (
        []
        if step is None
        else [f"{REGISTRY.step_names.index(step) + 1} {REGISTRY.lines[step].title}"]
    )
    return ", ".join(words if activity is None else [*words, doing(activity)])


def in_words(text: str) -> str:
    """Return a message with the labels of fields in place of the names of parameters."""
    names = parameter_names()
    told = re.sub(
        r"\b[a-z][a-z0-9]*(?:_[a-z0-9]+)+\b",
        lambda found: label_of(found[0]) if found[0] in names else found[0],
        text,
    )
    return told if told == text else told[:1].upper() + told[1:]
