"""Bring the manifest of an older file to the present schema, one pure function per step."""

from typing import Any

from rona_core.devices.limits import limits_of
from rona_core.devices.world_settings import WorldSettings
from rona_core.errors import SessionFormatError
from rona_core.session.codec import digest
from rona_core.session.digest_migration import with_present_digests
from rona_core.session.message_migration import with_present_message

SCHEMA = 6  # raise it with every change of the document, and add the step below

# What the tracker was before schema 2: errors alike everywhere, nothing in the way, no faults.
FIRST_PLACE: dict[str, Any] = {
    "$type": "TrackerPlace",
    "shift_mm": [0.0, 0.0, 0.0],
    "turn_deg": 0.0,
}
PLAIN_TRACKER: dict[str, Any] = {
    "stereo": False,
    "depth_ratio": 3.0,
    "occlusion": False,
    "phantom_share": 0.0,
    "latency_ms": None,
    "drift_mm": 0.0,
    "minutes_on": 60.0,
    "dropped_share": 0.0,
    "place": FIRST_PLACE,
}
# Nobody had changed a path by hand before schema 2.
NO_EDITS: dict[str, Any] = {"$type": "PathEdits", "changes": []}
# Results that schema 2 holds more of than schema 1 knew: covariances, verdicts, bounds.
OUTGROWN = ("tool", "pointer", "smoothing")
NEW = ("registration",)  # results that schema 1 did not know


def from_1(manifest: dict[str, Any]) -> dict[str, Any]:
    """Return a manifest of schema 1 as one of schema 2.

    Its captures were measured by a tracker that nobody moved, without the faults that can be
    switched on now and without a marker on the robot base, and its path had no changes by hand.
    What the outgrown results lack cannot be made up, so they go: one click computes each again
    from its capture, and until then what was computed with them shows as stale.
    """
    session = manifest["session"]
    devices = session["setup"]["devices"]
    tracker = {**PLAIN_TRACKER, **devices["tracker"]}
    setup = {
        **session["setup"],
        "devices": {**devices, "tracker": tracker},
        "use_base_marker": True,
    }
    held = session["captures"]
    captures = {
        **held,
        **{kind: _tracked(held[kind]) for kind in ("tool", "pointer", "path")},
        "surface": [_tracked(stroke) for stroke in held["surface"]],
    }
    results = {**session["results"], **dict.fromkeys((*OUTGROWN, *NEW))}
    changed = {
        **session,
        "setup": setup,
        "captures": captures,
        "archive": [_tracked(capture) for capture in session["archive"]],
        "results": results,
        "path_edits": NO_EDITS,
    }
    return {**manifest, "schema": 2, "session": changed}


def _tracked(capture: Any) -> Any:
    """Return a capture of schema 1 with what is known now of base marker and tracker."""
    if capture is None or "marker" not in capture:
        return capture
    return {**capture, "base": None, "tracker_place": FIRST_PLACE}


# What stood around the robot before schema 3, when nobody could say otherwise.
FIRST_SURROUNDINGS: dict[str, Any] = {
    "$type": "Surroundings",
    "table": True,
    "table_center_mm": [630.0, 0.0, -175.0],
    "table_size_mm": [1500.0, 600.0, 60.0],
    "floor_mm": 0.0,
    "head_below_mm": 90.0,
    "stand_radius_mm": 120.0,
    "head_margin_mm": 10.0,
    "margin_mm": 20.0,
    "self_margin_mm": 5.0,
    "boxes": [],
}
# Fields that schema 3 gave to values of schema 2: class -> field -> value it had in effect.
ADDED_IN_3: dict[str, dict[str, Any]] = {
    "Captures": {  # nobody had taken them
        "second": [],
        "references": None,
        "block": None,
        "sono_pivot": None,
        "sono_spin": None,
        "sono_scan": None,
    },
    "Setup": {
        "bone": {"$type": "BoneChoice", "kind": "normal", "own_speed": False},
        "surroundings": FIRST_SURROUNDINGS,
    },
    "ProbeSettings": {
        "centre_mhz": None,
        "bandwidth": None,
        "aperture_mm": None,
        "line_length_mm": None,
        "pulse_shape": None,
        "adc_bits": None,
        "gain_db": 0.0,
        "line_temperature_c": 22.0,
    },
    "RobotSettings": {"contact": None, "latency_ms": 0.0},
    "ScanCapture": {"forces": None, "clock_scans": None},
    "Surroundings": {"boxes": []},  # nobody could add any
    # nobody had set a boundary by hand
    "Session": {"boundary_edits": {"$type": "BoundaryEdits", "changes": []}},
}
# Fields that values of schema 3 no longer have. The scatter of samples about a map passed for its
# error, 10 to 160 times too small; how sure a map is follows from its samples, and is not stored.
GONE_FROM_3: dict[str, tuple[str, ...]] = {"BoundaryMap": ("sigma_mm",)}
# Results of schema 2 that schema 3 holds more of: computed again by one click each.
OUTGROWN_IN_3 = ("roll", "detection", "maps")
NEW_IN_3 = (  # results that schema 2 did not know
    "second",
    "second_detection",
    "line",
    "speed",
    "what_if",
    "placement",
    "sono",
    "sono_detection",
    "sono_maps",
)


def from_2(manifest: dict[str, Any]) -> dict[str, Any]:
    """Return a manifest of schema 2 as one of schema 3.

    Captures and settings keep what they had; what they did not know of gets the value that stands
    for its absence. Plans, boundaries and maps go: they lack what cannot be made up, and are
    computed again from the captures.
    """
    session = _with_fields(manifest["session"], ADDED_IN_3)
    gone = dict.fromkeys((*OUTGROWN_IN_3, *NEW_IN_3))
    changed = {**session, "results": {**session["results"], **gone}}
    return {**manifest, "schema": 3, "session": changed}


def _with_fields(value: Any, added: dict[str, dict[str, Any]]) -> Any:
    """Return plain values with the fields that their classes have got since."""
    if isinstance(value, list):
        return [_with_fields(item, added) for item in value]
    if not isinstance(value, dict):
        return value
    inside = {key: _with_fields(item, added) for key, item in value.items()}
    return {**added.get(str(value.get("$type")), {}), **inside}


def from_3(manifest: dict[str, Any]) -> dict[str, Any]:
    """Return a manifest of schema 3 as one of schema 4: its log and results name present messages.

    No capture and no result is lost.
    """
    session = manifest["session"]
    results = {name: with_present_message(held) for name, held in session["results"].items()}
    log = [with_present_message(entry) for entry in session.get("log", ())]
    return {**manifest, "schema": 4, "session": {**session, "results": results, "log": log}}


# Fields that schema 5 gave to values of schema 4: the world was as it was told.
ADDED_IN_5: dict[str, dict[str, Any]] = {
    "Setup": {
        "world": {
            "$type": "WorldSettings",
            "profile": "nominal",
            **dict.fromkeys(name for name in limits_of(WorldSettings) if name != "profile"),
        }
    },
}


def from_4(manifest: dict[str, Any]) -> dict[str, Any]:
    """Return a manifest of schema 4 as one of schema 5, whose set-up names the virtual world."""
    session = _with_fields(manifest["session"], ADDED_IN_5)
    return {**manifest, "schema": 5, "session": session}


# Results of schema 5 that remember the digest of the one further pass, and what they call it.
OF_SECOND = {"second_detection": "capture", "maps": "second"}


def from_5(manifest: dict[str, Any]) -> dict[str, Any]:
    """Return a manifest of schema 5 as one of schema 6, in which further passes add up.

    The one that there may be is the first of them, and what was made of it stays fresh.
    """
    session = manifest["session"]
    held = session["captures"].get("second")
    passes = held if isinstance(held, list) else [] if held is None else [held]
    results = dict(session["results"])
    for name, key in OF_SECOND.items():
        derived = results.get(name)
        if derived is not None and key in derived["inputs"]:
            known = derived["inputs"][key]
            of_all = digest([]) if known == digest(None) else digest([known])
            results[name] = {**derived, "inputs": {**derived["inputs"], key: of_all}}
    captures = {**session["captures"], "second": passes}
    changed = {**session, "captures": captures, "results": results}
    return {**manifest, "schema": 6, "session": changed}


# MIGRATIONS[n] turns a manifest of schema n into one of schema n + 1.
MIGRATIONS = {1: from_1, 2: from_2, 3: from_3, 4: from_4, 5: from_5}


def migrate(manifest: dict[str, Any]) -> dict[str, Any]:
    """Return ``manifest`` in the present schema.

    Raises:
        SessionFormatError: no schema number, or one that is newer than this program.
    """
    schema = manifest.get("schema")
    if type(schema) is not int or schema < 1:
        raise SessionFormatError(
            f"the session file names no schema number, but {str(schema)[:40]!r}"
        )
    if schema > SCHEMA:
        version = str(manifest.get("app_version", "unknown"))[:40]
        raise SessionFormatError(
            f"the session file has schema {str(schema)[:40]}, this program reads up to {SCHEMA}: "
            f"it was saved by a newer RONA ({version}); update first"
        )
    while schema < SCHEMA:
        try:
            manifest = MIGRATIONS[schema](manifest)
        except (KeyError, TypeError, AttributeError) as error:
            raise SessionFormatError(
                f"the session file of schema {schema} lacks a part that every one has: {error}"
            ) from error
        schema += 1
    return _completed(manifest)


# Fields that values of the present schema have got since: class -> field -> value in older files.
ADDED_SINCE: dict[str, dict[str, Any]] = {"WorldSettings": {"spindle_mm": None}}  # drawn


def _completed(manifest: dict[str, Any]) -> dict[str, Any]:
    """Return a manifest of the present schema with the fields that it has now."""
    session = manifest.get("session")
    if not session:
        return manifest
    version = str(manifest.get("app_version", ""))[:40]  # of what the results do not say themselves
    added = {**ADDED_IN_3, **ADDED_SINCE, "Derived": {"version": version}}
    present = _without_fields(_with_fields(session, added), GONE_FROM_3)
    return {**manifest, "session": with_present_digests(present)}


def _without_fields(value: Any, gone: dict[str, tuple[str, ...]]) -> Any:
    """Return plain values without the fields that their classes have lost since."""
    if isinstance(value, list):
        return [_without_fields(item, gone) for item in value]
    if not isinstance(value, dict):
        return value
    lost = gone.get(str(value.get("$type")), ())
    return {key: _without_fields(item, gone) for key, item in value.items() if key not in lost}
