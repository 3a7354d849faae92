"""Damaged files of every format: only errors of RONA escape from the readers."""

import contextlib
import io
import json
import os
import zipfile
from hashlib import sha256

import numpy as np
import pytest

from rona_core.errors import RonaError
from rona_core.session.files import session_from_bytes
from tests.helpers.damaged_files import FORMATS, SESSION, mutated

pytestmark = pytest.mark.slow

MANY = int(os.environ.get("RONA_FUZZ", "1"))  # times as many mutations


@pytest.mark.parametrize(("make", "read", "count"), FORMATS.values(), ids=FORMATS)
def test_only_errors_of_rona_escape(make, read, count, tmp_path):
    data, rng = make(tmp_path), np.random.default_rng(7)
    with contextlib.suppress(RonaError):  # what is not damaged may be refused too, as too small
        read(data, tmp_path)
    for _ in range(count * MANY):
        with contextlib.suppress(RonaError):
            read(mutated(data, rng), tmp_path)


# ------------------------------------------------------------------ what a sealed session says

VALUES = (None, [], {}, "", "x", 0, -1, 10**30, 1e300, True, [[]], [1], {"array": []}, {"$type": 1})


def places(value, found):
    """Every object and list in plain values."""
    if isinstance(value, dict | list):
        found.append(value)
        for item in value.values() if isinstance(value, dict) else value:
            places(item, found)
    return found


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # numbers that overflow are refused after
def test_only_errors_of_rona_escape_from_sealed_sessions():
    rng = np.random.default_rng(8)
    with zipfile.ZipFile(SESSION) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    text = members.pop("manifest.json")
    arrays = [name for name in members if name.endswith(".npy")]
    for _ in range(200 * MANY):
        manifest, changed = json.loads(text), dict(members)
        for _ in range(int(rng.integers(1, 4))):
            inside = places({k: v for k, v in manifest.items() if k != "sha256"}, [])
            place = inside[int(rng.integers(0, len(inside)))]
            keys = list(place) if isinstance(place, dict) else list(range(len(place)))
            if not keys:
                continue
            key = keys[int(rng.integers(0, len(keys)))]
            match int(rng.integers(0, 4)):
                case 0:
                    del place[key]
                case 1:
                    name = arrays[int(rng.integers(0, len(arrays)))]
                    changed[name] = mutated(changed[name], rng)
                case _:
                    place[key] = VALUES[int(rng.integers(0, len(VALUES)))]
        manifest["sha256"] = {name: sha256(data).hexdigest() for name, data in changed.items()}
        out = io.BytesIO()
        with zipfile.ZipFile(out, "w") as archive:
            archive.writestr("manifest.json", json.dumps(manifest))
            for name, data in changed.items():
                archive.writestr(name, data)
        with contextlib.suppress(RonaError):
            session_from_bytes(out.getvalue())
