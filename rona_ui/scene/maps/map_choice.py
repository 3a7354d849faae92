"""Which maps are drawn: those of the robot's scan, or those of the scan by hand."""

from typing import Any

from rona_core.app.steps.maps.map_accuracy import MapAccuracy, map_accuracy
from rona_core.mapping.boundary_map import Maps
from rona_ui.view_state import Picture


def shows_hand(picture: Picture) -> bool:
    """Return whether the maps to be seen are those of the scan by hand."""
    results = picture.session.results
    return results.sono_maps is not None and (picture.view.by_hand or results.maps is None)


def chosen_maps(picture: Picture) -> Maps | None:
    """Return the maps to be seen, in ``base``; None before there are any.

    Maps that are given from the marker on the robot base, because no robot was registered, are
    brought to where that marker is drawn.
    """
    results = picture.session.results
    if not shows_hand(picture):
        return None if results.maps is None else results.maps.value
    made = None if results.sono_maps is None else results.sono_maps.value
    if made is None or made.frame == "base":
        return None if made is None else made.maps
    drawn = None if picture.backdrop is None else picture.backdrop.T_base_basemarker
    return made.maps if drawn is None else made.maps.seen_from(drawn)


def chosen_accuracy(picture: Picture) -> MapAccuracy | None:
    """Return how sure the maps to be seen are; None where nobody knows."""
    return map_accuracy(picture.session, hand=shows_hand(picture))


def chosen_key(picture: Picture) -> tuple[Any, ...]:
    """Return what the chosen maps depend on: the same objects mean the same maps."""
    results = picture.session.results
    made = results.sono_maps if shows_hand(picture) else results.maps
    return (id(made), id(picture.backdrop))
