"""Labels: maps names of parameters and activities to the words shown in the interface."""

import re
from collections.abc import Mapping
from functools import cache

from rona_core.app.declarations.registry import REGISTRY
from rona_core.devices.limits import heading, limits_of

# of parameters without a label of their own
UNITS = {
    "mm_per_us": "mm/µs", "mm_per_s": "mm/s", "mm": "mm", "deg": "deg", "s": "s", "ms": "ms",
    "us": "µs", "db": "dB", "mhz": "MHz", "hz": "Hz", "n": "N", "c": "°C",
}  # fmt: skip


@cache
def parameter_labels() -> Mapping[str, frozenset[str]]:
    """Return how the parameters of messages are labelled, by names of several words."""
    found: dict[str, set[str]] = {}
    for kind in REGISTRY.messages.values():
        for name, words in limits_of(kind).items():
            if "_" in name:
                found.setdefault(name, set()).update({heading(words)} if "label" in words else ())
    return {name: frozenset(labels) for name, labels in found.items()}


def label_of(name: str) -> str:
    """Return what people read for a parameter: its label where it has one, else its name."""
    known = parameter_labels().get(name, frozenset[str]())
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
    names = parameter_labels()
    replaced = re.sub(
        r"\b[a-z][a-z0-9]*(?:_[a-z0-9]+)+\b",
        lambda found: label_of(found[0]) if found[0] in names else found[0],
        text,
    )
    return replaced if replaced == text else replaced[:1].upper() + replaced[1:]
