"""Markups of a bed for 3D Slicer (``.mrk.json``): outline, axis, screws, thinnest bone."""

import numpy as np

from rona_core.geometry.arrays import Vector3
from rona_core.geometry.pose import Pose
from rona_core.mapping.files.markups import closed_curve, markup, markups_file
from rona_core.planning.implants.implant import Implant


def bed_markups(
    implant: Implant, T_base_bed: Pose, thinnest_base: Vector3, residual_mm: float
) -> bytes:
    """Return the outline of a bed on its seat, its axis, its screws and its thinnest place.

    All in ``base``, in mm; labels give the depth, the length of each screw and the bone left.

    Args:
        implant: On its lift.
        T_base_bed: Where it is laid.
        thinnest_base: Place (3,) of the bed below which the least bone is left.
        residual_mm: That bone, by the maps.
    """
    found = [
        closed_curve(
            f"bed of {implant.name}",
            T_base_bed @ np.column_stack((ring[:-1], np.zeros(len(ring) - 1))),
            "outline",
        )
        for ring in implant.outline()
    ]
    depth_mm = implant.terraces()[-1].depth_mm
    ends = np.array([(0.0, 0.0, 0.0), (0.0, 0.0, -depth_mm)])
    labels = ["seat", f"{depth_mm:.2f} mm deep"]
    found.append(markup("Line", "axis of the bed", T_base_bed @ ends, labels))
    for number, screw in enumerate(implant.screws, start=1):
        ends = np.array([(screw.x_mm, screw.y_mm, z) for z in (0.0, -screw.length_mm)])
        labels = ["entry", f"{screw.length_mm:g} mm long"]
        found.append(markup("Line", f"screw {number}", T_base_bed @ ends, labels))
    label = f"thinnest {residual_mm:.2f} mm"
    found.append(markup("Fiducial", "bone left", thinnest_base[None], [label]))
    return markups_file(*found)
