"""Which maps are drawn: those of the robot's scan, or those of the scan by hand."""

from typing import Any

from rona_core.app.steps.maps.map_accuracy import MapAccuracy, map_accuracy
from rona_core.mapping.boundary_map import Maps
from rona_ui.presentation.snapshot import Snapshot


def shows_handheld_maps(snapshot: Snapshot) -> bool:
    """Return whether the maps to be seen are those of the scan by hand."""
    results = snapshot.session.results
    return results.sono_maps is not None and (snapshot.view.handheld or results.maps is None)


def shown_maps(snapshot: Snapshot) -> Maps | None:
    """Return the maps to be seen, in ``base``; None before there are any.

    Maps that are given from the marker on the robot base, because no robot was registered, are
    brought to where that marker is drawn.
    """
    results = snapshot.session.results
    if not shows_handheld_maps(snapshot):
        return None if results.maps is None else results.maps.value
    made = None if results.sono_maps is None else results.sono_maps.value
    if made is None or made.frame == "base":
        return None if made is None else made.maps
    drawn = None if snapshot.static_scene is None else snapshot.static_scene.T_base_basemarker
    return made.maps if drawn is None else made.maps.seen_from(drawn)


def shown_map_accuracy(snapshot: Snapshot) -> MapAccuracy | None:
    """Return how sure the maps to be seen are; None where nobody knows."""
    return map_accuracy(snapshot.session, hand=shows_handheld_maps(snapshot))


def shown_maps_key(snapshot: Snapshot) -> tuple[Any, ...]:
    """Return what the chosen maps depend on: the same objects mean the same maps."""
    results = snapshot.session.results
    made = results.sono_maps if shows_handheld_maps(snapshot) else results.maps
    return (id(made), id(snapshot.static_scene))


def map_sigma(snapshot: Snapshot) -> MapAccuracy | None:
    """Return how sure the maps are, where they are coloured by it: it takes a moment."""
    return shown_map_accuracy(snapshot) if snapshot.view.quantity == "sigma" else None
