"""Markups of a bed: the outline lies on its seat, screws and thinnest place where they are."""

import json

import numpy as np
import pytest

from rona_core.geometry.pose import Pose
from rona_core.planning.implants.bed_markups import bed_markups
from rona_core.planning.implants.implant import implant_named

T_BASE_BED = Pose.from_rotvec((0.3, -2.0, 0.9), (400.0, -20.0, 310.0))
THINNEST = np.array((404.0, -23.0, 306.0))


def markups_of(name, lift_mm=0.0):
    data = bed_markups(implant_named(name).lifted(lift_mm), T_BASE_BED, THINNEST, 1.234)
    found = json.loads(data)
    assert found["@schema"].endswith("markups-schema-v1.0.3.json#")
    assert {one["coordinateUnits"] for one in found["markups"]} == {"mm"}
    return found["markups"]


def places_bed(markup):
    return T_BASE_BED.inv() @ np.array([point["position"] for point in markup["controlPoints"]])


def test_the_outline_goes_once_round_the_seat_and_no_point_is_double():
    ring = places_bed(markups_of("BCI 602")[0])
    np.testing.assert_allclose(ring[:, 2], 0.0, atol=1e-9)
    np.testing.assert_allclose(np.hypot(ring[:, 0], ring[:, 1]), 9.1, atol=0.02)
    assert np.linalg.norm(np.diff(ring, axis=0, append=ring[:1]), axis=1).min() > 1e-3


@pytest.mark.parametrize("lift_mm", [0.0, 1.0])
def test_axis_and_screws_go_as_deep_as_they_are_long(lift_mm):
    implant = implant_named("BCI 602")
    lines = [one for one in markups_of("BCI 602", lift_mm) if one["type"] == "Line"]
    depths = [-places_bed(line)[1, 2] for line in lines]
    lengths = [screw.length_mm for screw in implant.screws]
    np.testing.assert_allclose(depths, [4.5 - lift_mm, *lengths])
    starts = np.array([places_bed(line)[0] for line in lines[1:]])
    at = [(screw.x_mm, screw.y_mm) for screw in implant.screws]
    np.testing.assert_allclose(starts[:, :2], at, atol=1e-9)


def test_the_thinnest_place_carries_the_bone_left():
    last = markups_of("CI receiver")[-1]
    assert (last["type"], last["controlPoints"][0]["label"]) == ("Fiducial", "thinnest 1.23 mm")
    np.testing.assert_allclose(last["controlPoints"][0]["position"], THINNEST)
