"""The codec: what goes in comes back, bit by bit, and nothing else does."""

import json
from dataclasses import dataclass, field, replace
from typing import Generic, Literal, TypeVar

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from rona_core.devices.limits import limited
from rona_core.errors import SessionFormatError
from rona_core.geometry.arrays import Bools, Floats
from rona_core.geometry.pose import Pose, Poses
from rona_core.session.codec import decode, digest, encode

T = TypeVar("T")


@dataclass(frozen=True, slots=True, eq=False)
class Leaf:
    points: Floats
    mask: Bools
    label: Literal["a", "b"] = "a"


@dataclass(frozen=True, slots=True, eq=False)
class Other:
    number: int


@dataclass(frozen=True, slots=True, eq=False)
class Box(Generic[T]):
    value: T
    note: str | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Tree:
    pose: Pose
    leaf: Box[Leaf] | None = None
    either: Leaf | Other = field(default_factory=lambda: Other(3))
    several: tuple[Leaf, ...] = ()
    triple: tuple[float, float, float] = (0.0, 1.0, 2.0)
    plain: dict[str, object] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Grown:
    old: float
    shots: int = limited(32, before=1)
    relief_mm: float | None = limited(None, before=0.0)


def test_a_field_that_was_added_later_is_as_before_in_files_without_it_and_changes_no_digest():
    stored = {"$type": "Grown", "old": 2.0}
    found = decode(stored, Grown, {})
    assert found == Grown(2.0, 1, 0.0)
    assert encode(found, "", {}) == stored
    for new in (Grown(2.0), Grown(2.0, 1), Grown(2.0, 32, 0.0)):
        assert decode(encode(new, "", {}), Grown, {}) == new
        assert digest(new) != digest(found)


def leaf(n: int = 7) -> Leaf:
    rng = np.random.default_rng(n)
    return Leaf(rng.normal(size=(n, 3)), rng.random(n) > 0.5, "b")


def tree() -> Tree:
    return Tree(
        Pose.from_rotvec((0.1, -0.2, 0.3), (1.0, 2.0, 3.0)),
        Box(leaf(40), "forty"),
        leaf(2),
        (leaf(3), leaf(30)),
        (0.1, 1e-300, -7.0),
        {"tolerance_mm": 1.0, "picks": [[1.0, 2.0, 3.0]], "name": None},
    )


def through(value: object, hint: object) -> object:
    arrays: dict[str, np.ndarray] = {}
    text = json.dumps(encode(value, "root", arrays), allow_nan=False)
    return decode(json.loads(text), hint, arrays)


def test_a_tree_of_dataclasses_comes_back_bit_by_bit():
    back = through(tree(), Tree)
    assert isinstance(back, Tree)
    assert digest(back) == digest(tree())
    np.testing.assert_array_equal(back.leaf.value.points, tree().leaf.value.points)
    assert isinstance(back.either, Leaf)
    assert back.leaf.value.mask.dtype == np.bool_


def test_poses_come_back_bit_by_bit_through_their_own_checks():
    poses = Poses.stack([Pose.from_rotvec((0.01 * i, 0.3, -0.2), (i, 0, 1)) for i in range(9)])
    back = through(poses, Poses)
    np.testing.assert_array_equal(back.rotations, poses.rotations)


@settings(max_examples=40)
@given(
    npst.arrays(
        dtype=st.sampled_from([np.float64, np.float32, np.int64, np.int16, np.bool_]),
        shape=npst.array_shapes(min_dims=0, max_dims=3, max_side=9),
        elements={"allow_nan": False, "allow_infinity": False},
    )
)
def test_every_array_keeps_shape_type_and_bits(array):
    back = through(array, np.ndarray)
    assert back.dtype == array.dtype
    assert back.shape == array.shape
    np.testing.assert_array_equal(back, array)
    assert not back.flags.writeable


def test_the_digest_tells_any_change_apart():
    one = tree()
    points = one.leaf.value.points.copy()
    points[5, 1] = np.nextafter(points[5, 1], np.inf)
    changed = replace(one, leaf=Box(replace(one.leaf.value, points=points), "forty"))
    assert digest(changed) != digest(one)
    assert digest(replace(one, triple=(0.1, 1e-300, -7.5))) != digest(one)
    assert digest(tree()) == digest(one)


@pytest.mark.parametrize(
    "spoil",
    [
        lambda d: d.pop("pose"),
        lambda d: d.update(extra=1),
        lambda d: d.update(triple=[1.0, 2.0]),
        lambda d: d.update(triple=[1.0, "2", 3.0]),
        lambda d: d["either"].update({"$type": "Pose"}),
        lambda d: d["pose"].update({"$type": "Leaf"}),  # its fields are those of a pose
        lambda d: d["leaf"]["value"]["points"].update(array="nowhere"),
        lambda d: d.update(several={"0": 1}),
        lambda d: d["pose"]["rotation"].update(values=[2.0] * 9),
    ],
)
def test_data_that_do_not_fit_are_refused_with_their_place(spoil):
    arrays: dict[str, np.ndarray] = {}
    data = encode(tree(), "root", arrays)
    spoil(data)
    with pytest.raises(SessionFormatError, match="session"):
        decode(data, Tree, arrays)


def test_objects_that_are_no_plain_values_are_refused():
    with pytest.raises(SessionFormatError, match="cannot hold a set"):
        encode({"x": {1, 2}}, "root", {})
    with pytest.raises(SessionFormatError, match="arrays of"):
        encode(np.array(["text"]), "root", {})
