"""Markups of the maps: the rim goes once about the bone, extremes are where they are said to be."""

import json
from dataclasses import replace

import numpy as np
import pytest

from rona_core.errors import DegenerateGeometryError
from rona_core.mapping.files.map_sheet import MapSheet
from rona_core.mapping.files.markups import maps_markups
from tests.scenes.map_sheets import CELL_U_MM, CELL_V_MM, T_BASE_MAP, dome_sheet


@pytest.fixture(scope="module")
def markups():
    found = json.loads(maps_markups(dome_sheet()))
    assert found["@schema"].endswith("markups-schema-v1.0.3.json#")
    return {markup["type"]: markup for markup in found["markups"]}


def places_map(markup):
    places = np.array([point["position"] for point in markup["controlPoints"]])
    return T_BASE_MAP.inv() @ places


def test_the_rim_is_the_outer_one_and_closes(markups):
    rim = markups["ClosedCurve"]
    assert (rim["coordinateSystem"], rim["coordinateUnits"]) == ("LPS", "mm")
    u, v, _ = places_map(rim).T
    assert len(u) == 2 * (19 + 15) - 4
    on_u, on_v = np.isclose(abs(u), 9 * CELL_U_MM), np.isclose(abs(v), 7 * CELL_V_MM)
    assert (on_u | on_v).all()
    turn = np.unwrap(np.arctan2(np.append(v, v[0]), np.append(u, u[0])))
    assert turn[-1] - turn[0] == pytest.approx(2.0 * np.pi)  # counter-clockwise, seen from outside


def test_extremes_carry_thickness_and_sigma(markups):
    thin, thick = markups["Fiducial"]["controlPoints"]
    sheet = dome_sheet()
    assert thin["label"].startswith(f"thinnest {np.nanmin(sheet.thickness_mm()):.2f} +/- 0.")
    assert thick["label"].startswith(f"thickest {np.nanmax(sheet.thickness_mm()):.2f} +/- 0.")
    u = places_map(markups["Fiducial"])[:, 0]
    np.testing.assert_allclose(u, (-9.0 * CELL_U_MM, 9.0 * CELL_U_MM))


def test_without_a_stated_sigma_none_is_made_up_and_without_an_area_there_is_no_rim():
    sheet = dome_sheet()
    bare = json.loads(maps_markups(MapSheet(sheet.maps, {})))
    assert "+/-" not in json.dumps(bare["markups"][1])
    lonely = np.zeros_like(sheet.maps.inner.ok)
    lonely[5, 5] = True
    inner = replace(sheet.maps.inner, ok=lonely)
    with pytest.raises(DegenerateGeometryError, match="no three of them"):
        maps_markups(MapSheet(replace(sheet.maps, inner=inner), {}))
