"""Table of the maps: its numbers, its empty fields, and the schema that describes them."""

import csv
import io
import json

import numpy as np
import pytest

from rona_core.mapping.files.map_sheet import BOUNDARIES, MapSheet
from rona_core.mapping.files.map_table import columns_of, maps_csv, maps_schema
from tests.scenes.map_sheets import T_BASE_MAP, dome_sheet


def rows_of(sheet):
    return list(csv.DictReader(io.StringIO(maps_csv(sheet).decode("ascii"))))


def test_each_cell_that_is_mapped_is_a_row_with_its_places_and_its_sigma():
    sheet = dome_sheet()
    rows = rows_of(sheet)
    assert len(rows) == np.count_nonzero(sheet.maps.fused.ok)
    for name in BOUNDARIES:
        own = sheet.boundary(name)
        held = [row for row in rows if row[f"{name}_x_mm"]]
        places = np.array([[float(row[f"{name}_{axis}_mm"]) for axis in "xyz"] for row in held])
        np.testing.assert_allclose(places, own.points_base(), rtol=0.0, atol=1e-6)
        on_map = T_BASE_MAP.inv() @ places
        cells = np.array([[float(row["u_mm"]), float(row["v_mm"])] for row in held])
        np.testing.assert_allclose(on_map[:, :2], cells, atol=1e-5)
        total = [float(row[f"{name}_sigma_total_mm"]) for row in held]
        np.testing.assert_allclose(total, sheet.sigma_mm(name)["total"][own.ok], atol=1e-6)
    thickness = [float(row["thickness_mm"]) for row in rows if row["thickness_mm"]]
    np.testing.assert_allclose(thickness, sheet.thickness_mm()[sheet.thickness_ok()], atol=1e-6)


def test_the_schema_names_every_column_and_holds_for_every_row():
    sheet = dome_sheet()
    schema = json.loads(maps_schema())
    assert schema["required"] == list(schema["properties"]) == list(columns_of(sheet))
    for row in rows_of(sheet) + rows_of(MapSheet(sheet.maps, {})):
        for name, text in row.items():
            kind = schema["properties"][name]
            if not text:
                assert "null" in kind["type"], name
            else:
                assert float(text) >= kind.get("minimum", -np.inf), name


def test_a_validator_of_json_schema_takes_it():
    validators = pytest.importorskip("jsonschema", reason="jsonschema is not there: make viewers")
    schema = json.loads(maps_schema())
    checker = validators.Draft202012Validator(schema)
    checker.check_schema(schema)
    rows = [{k: float(t) if t else None for k, t in r.items()} for r in rows_of(dome_sheet())]
    assert all(checker.is_valid(row) for row in rows)
    assert not checker.is_valid({**rows[0], "outer_sigma_own_mm": -1.0})
    assert not checker.is_valid({**rows[0], "u_mm": None})
