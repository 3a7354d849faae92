"""Every array of a session has a declared shape, and one of another shape is refused by name."""

import dataclasses
import io
import json
import types
import typing
import zipfile
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

from rona_core.app.steps import STEPS
from rona_core.calibration.handheld.pointer import PointerCalibration
from rona_core.errors import SessionFormatError
from rona_core.session.codec import decode, encode
from rona_core.session.document import Session
from rona_core.session.files import session_bytes, session_from_bytes
from rona_core.session.shapes import INDICES, SHAPES

WHOLE = Path(__file__).resolve().parents[2] / "sessions" / "whole.rona"


def classes_of_sessions():
    """Every class that a session can hold, by its type hints."""
    found, left = {}, [Session, *declared_types()]
    while left:
        hint = left.pop()
        target = typing.get_origin(hint) or hint
        left += [a for a in typing.get_args(hint) if not isinstance(a, str | int)]
        if isinstance(target, type) and dataclasses.is_dataclass(target) and target not in found:
            found[target] = typing.get_type_hints(target)
            left += found[target].values()
    return found


def declared_types():
    """Classes that only a step declares."""
    parts = [part for step in STEPS for part in (*step.captures, *step.results)]
    return [kind for part in parts for kind in part.types]


def arrays_in(hint):
    if typing.get_origin(hint) in (typing.Union, types.UnionType):
        return any(arrays_in(part) for part in typing.get_args(hint))
    return typing.get_origin(hint) is np.ndarray


def test_every_array_of_the_document_has_a_declared_shape():
    classes = classes_of_sessions()
    assert len(classes) > 60
    by_name = {target.__name__: hints for target, hints in classes.items()}
    assert len(by_name) == len(classes)  # names tell them apart
    for name, hints in by_name.items():
        declared = {f for words in SHAPES.get(name, {}).values() for f in words.split()}
        arrays = {field for field, hint in hints.items() if arrays_in(hint)}
        assert arrays == {f for f in declared if f in arrays}, name
        assert {f.split(".")[0] for f in declared} | set(INDICES.get(name, {})) <= set(hints), name
    assert set(SHAPES) | set(INDICES) <= set(by_name)


def values_in(value, where=""):
    """Every dataclass in a session, with its place."""
    if dataclasses.is_dataclass(value):
        yield where, value
        for field in dataclasses.fields(value):
            yield from values_in(getattr(value, field.name), f"{where}/{field.name}")
    elif isinstance(value, tuple):
        for i, item in enumerate(value):
            yield from values_in(item, f"{where}/{i}")


def other_shapes(array):
    yield array.reshape(1, *array.shape)
    if array.size:
        yield array[..., None]
        yield array.reshape(-1)[0]  # a single number


def length_is_told(name, field):
    """Whether the first axis of a field is a number, or another field has it too."""
    axes = {f: line.split() for line, words in SHAPES[name].items() for f in words.split()}
    first = axes[field][0]
    others = [axis for other, line in axes.items() if other != field for axis in line]
    return first.isdigit() or first in others


def test_each_array_of_the_demo_session_is_refused_in_another_shape(demo):
    tried = set()
    for where, value in values_in(demo):
        kind = type(value)
        for field in dataclasses.fields(value):
            array = getattr(value, field.name)
            if not isinstance(array, np.ndarray) or (kind, field.name) in tried:
                continue
            tried.add((kind, field.name))
            arrays = {}
            plain = encode(value, "x", arrays)
            for other in other_shapes(array):
                inner = {}
                name = f"x/{field.name}"
                spoiled = {**plain, field.name: encode(np.asarray(other), name, inner)}
                with pytest.raises(SessionFormatError, match=rf"{field.name}|shape"):
                    decode(spoiled, kind, {**arrays, **inner}, where)
            if array.ndim and len(array) > 1:  # one row fewer than its neighbours have
                inner = {}
                short = encode(array[:-1].copy(), f"x/{field.name}", inner)
                if length_is_told(kind.__name__, field.name):
                    with pytest.raises(SessionFormatError):
                        decode({**plain, field.name: short}, kind, {**arrays, **inner}, where)
    assert len(tried) > 80


def spoiled(change):
    """The bytes of a small session after ``change(manifest)``; its digests hold."""
    out = io.BytesIO()
    with zipfile.ZipFile(WHOLE) as old:
        members = {name: old.read(name) for name in old.namelist()}
    manifest = json.loads(members.pop("manifest.json"))
    change(manifest, members)
    manifest["sha256"] = {name: sha256(data).hexdigest() for name, data in members.items()}
    with zipfile.ZipFile(out, "w") as new:
        new.writestr("manifest.json", json.dumps(manifest))
        for name, data in members.items():
            new.writestr(name, data)
    return out.getvalue()


def test_a_file_whose_array_has_another_shape_is_refused_with_name_and_shape():
    def change(manifest, members):
        manifest["session"]["results"]["pointer"]["value"]["used"] = {
            "values": [True],
            "shape": [1],
            "dtype": "|b1",
        }

    words = r"results/pointer/value/used: expected an array of shape \(\d+\), found \(1,\)"
    with pytest.raises(SessionFormatError, match=words):
        session_from_bytes(spoiled(change))


def test_an_array_of_another_kind_is_refused(demo):
    plain = encode(demo.results.pointer.value, "x", arrays := {})
    arrays["x/used"] = arrays["x/used"].astype(np.float64)
    with pytest.raises(SessionFormatError, match="used: expected an array of kind b"):
        decode(plain, PointerCalibration, arrays, "here")


def test_indices_that_lead_elsewhere_are_refused(demo):
    path = demo.results.smoothing.value.simplified
    plain = encode(path, "x", arrays := {})
    arrays["x/index"] = arrays["x/index"] + path.n_original
    with pytest.raises(SessionFormatError, match="index: expected indices from 0 to"):
        decode(plain, type(path), arrays, "here")


@pytest.mark.parametrize("depth", [70, 700, 900])
def test_plain_values_that_are_nested_without_end_are_refused(depth):
    def change(manifest, members):
        deep = 1
        for _ in range(depth):
            deep = [deep]
        manifest["session"]["results"]["pointer"]["arguments"] = {"a": deep}

    with pytest.raises(SessionFormatError, match=r"nested deeper|not readable"):
        session_from_bytes(spoiled(change))


@pytest.mark.parametrize("name", [[], {}, None, 1, True, [[1]]])
def test_the_name_of_an_array_is_a_text(name):
    def change(manifest, members):
        manifest["session"]["results"]["pointer"]["value"]["used"] = {"array": name}

    with pytest.raises(SessionFormatError, match=r"the array .* is missing"):
        session_from_bytes(spoiled(change))


@pytest.mark.parametrize("kind", ["O", "U500000000", "<U9", {"names": ["a"]}, ["<f8"], None, "V8"])
def test_a_small_array_is_of_numbers(kind):
    def change(manifest, members):
        manifest["session"]["results"]["pointer"]["value"]["pivot_tracker"]["dtype"] = kind

    with pytest.raises(SessionFormatError, match="expected a numeric array"):
        session_from_bytes(spoiled(change))


def test_what_could_not_be_read_again_is_not_written(demo, monkeypatch):
    monkeypatch.setattr("rona_core.session.members.MAX_STORED_BYTES", 1_000_000)
    with pytest.raises(SessionFormatError, match="start another session"):
        session_bytes(demo)
