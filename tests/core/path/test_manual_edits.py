"""Changes of a path by hand: what they leave, what must stay, how far the samples are off."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rona_core.errors import InvalidInputError
from rona_core.path.manual_edits import BY_HAND, PathEdit, distances_to_edited, edit_path
from rona_core.path.simplification.error_bound import deviations
from rona_core.path.simplification.simplify import simplify
from tests.helpers.strategies import random_pose, seeds

few = settings(max_examples=25, deadline=None)


def walk(rng, n=60):
    return np.cumsum(rng.normal(0.0, 1.0, (n, 3)), axis=0)


def random_edits(rng, n, count=4):
    edits, size = [], n
    for _ in range(count):
        first, last = sorted(rng.choice(np.arange(-1, size + 1), 2, replace=False).tolist())
        if first == -1 and last == size:
            first = 0
        new = [tuple(p) for p in rng.normal(0.0, 5.0, (int(rng.integers(0, 3)), 3)).tolist()]
        left = (first + 1) + len(new) + (size - last)
        if left < 2:
            continue
        ends = (None if first == -1 else first, None if last == size else last)
        edits.append(PathEdit("replace", *ends, tuple(new)))
        size = left
        edits.append(PathEdit("keep", int(rng.integers(size))))
    return edits


@given(seed=seeds)
@few
def test_changes_move_with_the_path(seed):
    rng = np.random.default_rng(seed)
    points, T = walk(rng), random_pose(rng)
    edits = random_edits(rng, len(points))
    moved = [
        PathEdit(e.kind, e.first, e.last, tuple(tuple(T @ np.array(p)) for p in e.points_base))
        for e in edits
    ]
    a, b = edit_path(points, edits), edit_path(T @ points, moved)
    np.testing.assert_allclose(b.points_base, T @ a.points_base, atol=1e-9)
    np.testing.assert_array_equal(a.samples, b.samples)
    np.testing.assert_array_equal(a.keep, b.keep)


@given(seed=seeds)
@few
def test_a_list_of_changes_is_the_same_as_plain_lists_changed_one_by_one(seed):
    rng = np.random.default_rng(seed)
    points = walk(rng)
    edits = random_edits(rng, len(points))
    plain = [[tuple(p), i, False] for i, p in enumerate(points.tolist())]
    for edit in edits:
        if edit.kind == "keep":
            plain[edit.first][2] = True
            continue
        head = [] if edit.first is None else plain[: edit.first + 1]
        tail = [] if edit.last is None else plain[edit.last :]
        new = [[p, BY_HAND, True] for p in edit.points_base]
        if head:
            head[-1][2] = True
        if tail:
            tail[0][2] = True
        plain = head + new + tail
        plain[0][2] = plain[0][2] or edit.first is None
        plain[-1][2] = plain[-1][2] or edit.last is None
    found = edit_path(points, edits)
    np.testing.assert_array_equal(found.points_base, [p for p, _, _ in plain])
    assert found.samples.tolist() == [i for _, i, _ in plain]
    assert found.keep.tolist() == [k for _, _, k in plain]


@given(seed=seeds)
@few
def test_without_changes_the_distances_are_those_of_k1(seed):
    points = walk(np.random.default_rng(seed))
    path = edit_path(points)
    kept = simplify(points, 1.5).index
    distances = distances_to_edited(points, path, kept)
    assert distances.max() == pytest.approx(deviations(points, kept).k1_mm, abs=1e-12)
    assert (distances <= 1.5 + 1e-9).all()


@given(seed=seeds, tolerance=st.floats(0.2, 4.0))
@few
def test_what_was_put_in_stays_whatever_the_bound(seed, tolerance):
    rng = np.random.default_rng(seed)
    points = walk(rng)
    path = edit_path(points, random_edits(rng, len(points)))
    kept = simplify(path.points_base, tolerance, keep=path.keep).index
    assert set(np.flatnonzero(path.keep)) <= set(kept.tolist())
    distances = distances_to_edited(points, path, kept)
    assert np.isfinite(distances).all()
    there = path.samples[path.samples >= 0]
    assert (distances[there] <= tolerance + 1e-9).all()


def test_samples_taken_away_are_measured_to_what_stands_in_their_place():
    points = np.column_stack((np.arange(11.0), np.zeros(11), np.zeros(11)))
    path = edit_path(points, [PathEdit("replace", 2, 8, ((5.0, 3.0, 0.0),))])
    assert path.samples.tolist() == [0, 1, 2, BY_HAND, 8, 9, 10]
    kept = simplify(path.points_base, 0.1, keep=path.keep).index
    assert kept.tolist() == [0, 2, 3, 4, 6]
    distances = distances_to_edited(points, path, kept)
    np.testing.assert_allclose(distances[[0, 1, 2, 8, 9, 10]], 0.0, atol=1e-12)
    assert distances[5] == pytest.approx(3.0 / np.sqrt(2.0))  # to the slope of 45 degrees
    gone = edit_path(points, [PathEdit("replace", None, 4)])
    assert gone.samples.tolist() == list(range(4, 11))
    off = distances_to_edited(points, gone, np.array([0, 6]))
    np.testing.assert_allclose(off, [4, 3, 2, 1, 0, 0, 0, 0, 0, 0, 0], atol=1e-12)


@pytest.mark.parametrize(
    "edit",
    [
        PathEdit("replace", None, None),
        PathEdit("replace", 3, 3),
        PathEdit("replace", 4, 2),
        PathEdit("replace", -1, 2),
        PathEdit("replace", 2, 10),
        PathEdit("replace", None, 9),
        PathEdit("replace", 1, 4, ((0.0, np.nan, 0.0),)),
        PathEdit("keep", 10),
        PathEdit("keep", -1),
        PathEdit("free", None),
    ],
)
def test_a_change_that_names_no_stretch_is_refused(edit):
    with pytest.raises(InvalidInputError, match="change 0"):
        edit_path(np.eye(10)[:, :3], [edit])
