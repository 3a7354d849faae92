"""Shapes of all arrays that a session holds: declared here, checked as soon as a value is loaded.

A shape is a row of axes: a number is a length, a letter a length that all fields of one value
share, wherever it stands. A field with dots lies in a part of the value; of a tuple the number of
its items counts. Parts that are None have no shape. A test sees that no array is left out.
"""

from typing import Any

import numpy as np

from rona_core.errors import SessionFormatError

# class -> axes -> fields
SHAPES: dict[str, dict[str, str]] = {
    "AScanTrack": {"n": "times_s clipped", "n samples": "rf"},
    "BasePlacement": {
        "x": "x_mm",
        "y": "y_mm",
        "x y": "margins turns_deg levels_mm blocked planned verified",
    },
    "BlockCapture": {"n": "tracks temperatures_c"},
    "BoundaryMap": {"u": "u_mm", "v": "v_mm", "u v": "height_mm ok"},
    "BurrRegistration": {
        "3": "offset_tip seat_base",
        "3 3": "covariance",
        "n": "residuals_mm used",
    },
    "CloudFit": {"6": "eigenvalues", "6 6": "covariance"},
    "DelayLine": {"n": "residuals_us"},
    "Detection": {
        "n": "outer_us inner_us outer_ok inner_ok outer_quality inner_quality flag standoff_mm "
        "thickness_mm outer_sigma_mm thickness_sigma_mm inner_sigma_us alternative_us "
        "alternative_quality"
    },
    "ForceTrack": {"n": "times_s force_n states travel_mm feed_share way_mm", "n 6": "wrench"},
    "GaugeCapture": {"k": "tracks depths_mm"},
    "ImplantBed": {"u v": "probability lacks"},
    "JointTrack": {"n": "times_s", "n 6": "qs_rad"},
    "LandmarkCapture": {"n": "names dwell_start_s dwell_end_s", "n 6": "qs_rad"},
    "LandmarkCheck": {"n": "names seen sigmas_mm", "n 3": "robot_base pointer_base"},
    "LoadedSkull": {
        "i j k": "distance_um",
        "3": "origin_skull center_skull normal_skull",
        "3 3": "axes_skull",
        "n 3": "mesh_vertices_skull",
        "m 3": "mesh_faces",
    },
    "LookCapture": {"n 3": "places_base", "k n 3": "axes_base"},
    "Maps": {
        "n 3": "outer_points_base inner_points_base",
        "n": "outer_used inner_used",
        "p": "offsets_mm",
        "u v": "outer.height_mm inner.height_mm fused.height_mm",
    },
    "MillingPlan": {"l": "layer_ends_s", "c": "changes_s"},
    "MotionCapture": {"n": "times_s", "n 6": "qs_rad"},
    "Normals": {
        "m 3": "normals eigenvalues",
        "m": "count sigma_deg ok radii_mm",
    },
    "Path5D": {"n 3": "points_base axes_base"},
    "PointerCapture": {"markers 3": "geometry_marker"},
    "PointerCalibration": {
        "3": "tip_pointermarker pivot_tracker",
        "3 3": "tip_covariance_pointermarker random_covariance",
        "n": "residuals_mm used",
    },
    "Pose": {"3 3": "rotation", "3": "translation"},
    "PlacedBed": {"3": "thinnest_base"},
    "Poses": {"n 3 3": "rotations", "n 3": "translations"},
    "RadiusChoice": {"k": "radii_mm noise_deg lean_deg"},
    "RawPath": {"n 3": "points_base"},
    "PointsCapture": {"n 3": "points_base"},
    "ProbeMounting": {"k": "residuals_mm"},
    "ReferenceCapture": {"n 3": "places_base", "n": "thickness_mm sigma_mm"},
    "Rehearsal": {"m": "scans measured_mm mapped_mm", "m 3": "places_bed"},
    "RollSearch": {
        "n": "rolls_rad",
        "n 3": "path.points_base",
        "rolls": "verdicts",
        "k": "shown_points",
        "rolls k 6": "curves_rad",
        "rolls k": "room",
        "k rolls": "node_room",
        "shown 6": "chosen_curve_rad",  # k or none
    },
    "SecondPassPath": {"n": "lean_deg", "n 3": "path.points_base"},
    "SeenBase": {"6 6": "covariance"},
    "SimplifiedPath": {"k": "index"},
    "SmoothPath": {
        "m 3": "way_points_base normals.normals",
        "k 3": "corners_base",
        "n": "from_raw_mm",
        "f": "from_filtered_mm",
    },
    "SonoCalibration": {"m": "spin_residuals_deg"},
    "SpeedCalibration": {
        "n": "point_speeds_mm_per_us residuals_mm strangeness weights variances",
        "n axes": "positions_mm",
    },
    "SurfaceCloud": {"n 3": "points_base", "n": "times_s strokes"},
    "SurfaceRegistration": {
        "6 6": "covariance directions_b",
        "n": "residuals_mm weights used",
        "3": "center_b",
        "6": "sigmas_mm",
    },
    "ToolCapture": {"n": "dwell_start_s dwell_end_s phases"},
    "ToolLoad": {"3": "com_sensor_mm", "6": "offset"},
    "ToolRegistration": {"n": "residuals_mm used", "12 12": "covariance random_covariance"},
    "ToolTrack": {
        "k": "frame_numbers times_s rms_error_mm",
        "k 3": "Ts_tracker_marker.translations",
    },
    "Trajectory": {"n": "times_s path_mm", "n 6": "qs_rad"},
    "WhatIf": {
        "c": "probes excitations snr_db thickness_mm failures unflagged coverage sd_mm bias_mm "
        "n_right"
    },
}

# class -> field of whole numbers -> what they count into: a field, or how many there are
INDICES: dict[str, dict[str, str | int]] = {
    "Detection": {"flag": 8},
    "ForceTrack": {"states": 6},
    "LoadedSkull": {"mesh_faces": "mesh_vertices_skull"},
    "RollSearch": {"shown_points": "rolls_rad"},
    "SimplifiedPath": {"index": "n_original"},
    "ToolCapture": {"phases": 3},
}


def check_shapes(value: Any, where: str) -> None:
    """Refuse a value of the session whose arrays do not have the shapes that are declared for it.

    Args:
        value: A dataclass; its parts have been checked before.
        where: Its place in the session, for the message.

    Raises:
        SessionFormatError: an array of another shape, or indices that lead out of what they count
            into.
    """
    name = type(value).__name__
    lengths: dict[str, int] = {}
    for axes, words in SHAPES.get(name, {}).items():
        for field in words.split():
            part = _part(value, field)
            if part is not None:
                _check(part, axes.split(), lengths, f"{where}/{field.replace('.', '/')}")
    for field_name, counted in INDICES.get(name, {}).items():
        bound = getattr(value, counted) if isinstance(counted, str) else counted
        bound = bound if isinstance(bound, int) else len(bound)
        _check_indices(getattr(value, field_name), bound, f"{where}/{field_name}")


def _part(value: Any, field: str) -> Any:
    for name in field.split("."):
        value = None if value is None else getattr(value, name)
    return value


def _check(part: Any, axes: list[str], lengths: dict[str, int], where: str) -> None:
    shape = part.shape if isinstance(part, np.ndarray) else (len(part),)
    fits = len(shape) == len(axes) and all(
        length == (int(axis) if axis.isdigit() else lengths.setdefault(axis, length))
        for axis, length in zip(axes, shape, strict=True)
    )
    if not fits:
        known = [str(lengths.get(axis, axis)) for axis in axes]
        raise SessionFormatError(
            f"{where}: expected an array of shape ({', '.join(known)}), found {tuple(shape)}"
        )


def _check_indices(array: Any, bound: int, where: str) -> None:
    if array.size and not (0 <= int(array.min()) and int(array.max()) < bound):
        raise SessionFormatError(
            f"{where}: expected indices from 0 to {bound - 1}, found {array.min()} to {array.max()}"
        )
