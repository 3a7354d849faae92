"""Table of the maps as CSV, one cell a row, and the JSON Schema that says what its columns are."""

import csv
import io
import json

import numpy as np

from rona_core.geometry.arrays import Floats
from rona_core.mapping.files.map_sheet import BOUNDARIES, MapSheet

SCHEMA_URI = "https://json-schema.org/draft/2020-12/schema"
ROUNDED = 6  # decimals of a millimetre


def columns_of(sheet: MapSheet) -> dict[str, Floats]:
    """Return all columns over the grid (nu, nv), NaN where a value is not known."""
    outer = sheet.maps.outer
    u, v = np.meshgrid(outer.u_mm, outer.v_mm, indexing="ij")
    columns = {"u_mm": u, "v_mm": v}
    for name in BOUNDARIES:
        ok = sheet.boundary(name).ok
        for axis, values in zip("xyz", np.moveaxis(sheet.points_base(name), -1, 0), strict=True):
            columns[f"{name}_{axis}_mm"] = np.where(ok, values, np.nan)
    columns["thickness_mm"] = sheet.thickness_mm()
    for name in (*BOUNDARIES, "thickness"):
        for part, values in sheet.sigma_mm(name).items():
            columns[f"{name}_sigma_{part}_mm"] = values
    return columns


def maps_csv(sheet: MapSheet) -> bytes:
    """Return the table; a value that is not known is empty, cells without any are left out."""
    columns = columns_of(sheet)
    known = np.any([sheet.boundary(name).ok for name in BOUNDARIES], axis=0)
    rows = np.column_stack([values[known] for values in columns.values()])
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(columns)
    for row in rows:
        writer.writerow(["" if np.isnan(value) else round(float(value), ROUNDED) for value in row])
    return text.getvalue().encode("ascii")


def maps_schema() -> bytes:
    """Return the JSON Schema of one row of the table, its columns by name."""
    number, maybe = {"type": "number"}, {"type": ["number", "null"]}
    axes = {
        "u_mm": {**number, "description": "centre of the cell along x of the map, mm"},
        "v_mm": {**number, "description": "centre of the cell along y of the map, mm"},
    }
    places = {
        f"{name}_{axis}_mm": {**maybe, "description": f"{axis} of the {words} in base, mm"}
        for name, words in zip(BOUNDARIES, _WORDS, strict=True)
        for axis in "xyz"
    }
    bone = "outer minus inner height along z of the map, mm"
    sigmas = {
        f"{name}_sigma_{part}_mm": {**maybe, "minimum": 0, "description": f"{words}, mm"}
        for name in (*BOUNDARIES, "thickness")
        for part, words in _PARTS.items()
    }
    properties = {**axes, **places, "thickness_mm": {**maybe, "description": bone}, **sigmas}
    schema = {
        "$schema": SCHEMA_URI,
        "title": "Cell of the boundary maps",
        "description": "One row of maps.csv (RFC 4180); an empty field is null: not known.",
        "type": "object",
        "properties": properties,
        "required": list(properties),
        "additionalProperties": False,
    }
    return json.dumps(schema, indent=1).encode("ascii")


_WORDS = (
    "outer boundary by ultrasound",
    "inner boundary by ultrasound",
    "outer boundary by ultrasound and pointer together",
)
_PARTS = {
    "total": "standard deviation, all parts together",
    "own": "standard deviation of what each cell has for itself",
    "common": "standard deviation of one error that all cells share",
}
