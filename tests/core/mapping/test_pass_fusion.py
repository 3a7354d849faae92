from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rona_core.mapping.pass_fusion import (
    AGREEING_MM,
    AROUND_MM,
    FACE_MM,
    LEAST_AROUND,
    TILTED_MM,
    UPRIGHT_MM,
    PassFusion,
    fuse_passes,
)

SIDE_MM = 24.0
seeds = st.integers(0, 2**31)


@dataclass(frozen=True)
class Passes:
    """A-scans of several passes over one square of bone, each pass off as a whole."""

    places_mm: np.ndarray
    depths_mm: np.ndarray
    sure: np.ndarray
    passes: np.ndarray

    def fused(self) -> PassFusion:
        return fuse_passes(self.places_mm, self.places_mm, self.depths_mm, self.sure, self.passes)


def passes_over(rng, offsets_mm, *, count=200, white_mm=0.1, face_mm=0.0):
    """Return passes whose A-scans err each for itself, and alike within a face."""
    numbers = np.repeat(np.arange(len(offsets_mm)), count)
    places = rng.uniform(0, SIDE_MM, (len(numbers), 2))
    bone = 6.0 + 0.05 * places[:, 0] + 0.5 * np.sin(places[:, 1] / 8.0)
    faces = rng.normal(0, face_mm, (len(offsets_mm), 8, 8))
    u, v = np.floor(places / FACE_MM).astype(int).T
    errors = rng.normal(0, white_mm, len(numbers)) + faces[numbers, u, v]
    sure = rng.uniform(size=len(numbers)) < np.where(numbers == 0, 0.35, 0.5)
    return Passes(places, bone + np.array(offsets_mm)[numbers] + errors, sure, numbers)


def left_mm(made, found, offsets_mm):
    """Return what is left of the offsets in the mean of all A-scans that agree."""
    counts = np.bincount(made.passes[found.agreeing], minlength=len(offsets_mm))
    return counts @ (found.offsets_mm - offsets_mm) / counts.sum()


def drawn(rng, count=5):
    return rng.normal(0, 1, count) * np.r_[UPRIGHT_MM, np.full(count - 1, TILTED_MM)]


@settings(max_examples=20, deadline=None)
@given(seeds, st.floats(0.02, 0.1), st.integers(2, 5))
def test_known_offsets_are_found_and_taken_out(seed, white_mm, count):
    rng = np.random.default_rng(seed)
    offsets = np.r_[0.0, rng.uniform(-0.5, 0.5, count - 1)]
    made = passes_over(rng, offsets, white_mm=white_mm)
    found = made.fused()
    np.testing.assert_allclose(found.offsets_mm, offsets, atol=0.2)
    assert abs(left_mm(made, found, offsets)) < 3.5 * found.sigma_mm
    assert found.agreeing[made.sure].mean() > 0.97
    assert not found.agreeing[~made.sure].any()


def test_an_offset_of_one_pass_leaves_the_points_of_that_pass_alone():
    made = passes_over(np.random.default_rng(1), (0.0, 0.0, 0.3, 0.0, 0.0), white_mm=0.05)
    found = made.fused()
    points = np.column_stack((made.places_mm, -made.depths_mm))
    moved = found.corrected(points) - points
    np.testing.assert_array_equal(moved[:, :2], 0.0)
    assert moved[made.passes == 2, 2] == pytest.approx(0.3, abs=0.05)  # it was too deep
    assert moved[made.passes != 2, 2] == pytest.approx(0.0, abs=0.05)


@settings(max_examples=20, deadline=None)
@given(seeds, st.floats(1.0, 3.0), st.sampled_from((-1.0, 1.0)))
def test_a_fifth_of_the_a_scans_at_another_depth_is_refused(seed, step_mm, side):
    rng = np.random.default_rng(seed)
    offsets = drawn(rng)
    made = passes_over(rng, offsets, white_mm=0.05)
    wrong = rng.uniform(size=len(made.passes)) < 0.2
    made.depths_mm[wrong] += side * step_mm
    found = made.fused()
    assert found.agreeing[made.sure & wrong].mean() < 0.1
    assert found.agreeing[made.sure & ~wrong].mean() > 0.95
    np.testing.assert_allclose(found.offsets_mm, offsets, atol=0.2)


def test_what_one_pass_alone_hears_at_another_depth_is_refused():
    """A step within the bone shows to one tilt of the probe, the boundary to all."""
    made = passes_over(np.random.default_rng(2), np.zeros(5), white_mm=0.05)
    middle = np.linalg.norm(made.places_mm - SIDE_MM / 2.0, axis=1) < 5.0
    of_step = middle & (made.passes == 3)
    made.depths_mm[of_step] -= 2.0
    found = made.fused()
    assert (made.sure & of_step).sum() > 5
    assert not found.agreeing[of_step].any()
    assert found.agreeing[made.sure & ~of_step].mean() > 0.97


@pytest.mark.parametrize("step_mm", [-2.5, 2.0, 4.0])
@pytest.mark.parametrize("count", [3, 5])
def test_a_pass_of_which_all_hear_another_boundary_is_refused_and_moves_no_other(step_mm, count):
    offsets = np.r_[0.0, np.linspace(-0.2, 0.2, count - 1), step_mm]
    made = passes_over(np.random.default_rng(count), offsets)
    found = made.fused()
    assert np.abs(found.offsets_mm[:count] - offsets[:count]).max() < 0.1
    assert found.agreeing[made.passes == count].mean() < 0.05
    assert found.agreeing[made.sure & (made.passes < count)].mean() > 0.9


def test_one_pass_alone_has_no_offset_and_is_as_sure_as_such_a_pass_is():
    made = passes_over(np.random.default_rng(3), (0.0,))
    found = made.fused()
    np.testing.assert_array_equal(found.offsets_mm, [0.0])
    assert found.sigma_mm == pytest.approx(UPRIGHT_MM)
    # the upright pass leaves A-scans with nobody around that may confirm them
    away = np.linalg.norm(made.places_mm[:, None] - made.places_mm[made.sure], axis=2)
    confirmed = (away <= AROUND_MM).sum(axis=1) >= LEAST_AROUND
    np.testing.assert_array_equal(found.agreeing, made.sure & confirmed)
    assert not confirmed[made.sure].all()


def test_an_empty_pass_has_no_offset_and_changes_nothing():
    rng = np.random.default_rng(4)
    made = passes_over(rng, (0.0, 0.2, 0.0, -0.3))
    silent = made.passes == 2
    made.sure[silent] = False
    found = made.fused()
    without = Passes(
        made.places_mm[~silent],
        made.depths_mm[~silent],
        made.sure[~silent],
        np.array((0, 1, 1, 2))[made.passes[~silent]],
    ).fused()
    assert found.offsets_mm[2] == 0.0
    np.testing.assert_allclose(found.offsets_mm[[0, 1, 3]], without.offsets_mm, atol=1e-12)
    np.testing.assert_array_equal(found.agreeing[~silent], without.agreeing)
    assert found.sigma_mm == pytest.approx(without.sigma_mm)


def test_without_a_sure_a_scan_nothing_agrees():
    made = passes_over(np.random.default_rng(5), np.zeros(3))
    found = Passes(made.places_mm, made.depths_mm, np.zeros(len(made.sure), bool), made.passes)
    assert not found.fused().agreeing.any()
    np.testing.assert_array_equal(found.fused().offsets_mm, 0.0)


def test_passes_that_do_not_overlap_say_nothing_of_each_other():
    made = passes_over(np.random.default_rng(6), (0.0, 0.4))
    made.places_mm[made.passes == 1, 0] += 2.0 * SIDE_MM
    found = made.fused()
    np.testing.assert_array_equal(found.offsets_mm, 0.0)
    counts = np.bincount(made.passes[found.agreeing])
    shares = counts / counts.sum()
    assert found.sigma_mm == pytest.approx(np.hypot(*(shares * (UPRIGHT_MM, TILTED_MM))))


def test_a_few_a_scans_far_from_others_agree_with_nobody():
    made = passes_over(np.random.default_rng(7), (0.0, 0.0))
    alone = np.zeros(len(made.passes), bool)
    alone[:2] = made.sure[:2] = True
    made.places_mm[alone] += 100.0
    assert not made.fused().agreeing[alone].any()


@pytest.mark.parametrize(
    ("white_mm", "face_mm"),
    [(0.1, 0.0), (0.05, 0.1), pytest.param(0.05, 0.2, marks=pytest.mark.slow)],
)
def test_the_sigma_of_what_is_left_of_the_offsets_holds(white_mm, face_mm):
    """A-scans within one face err alike; a sigma that counts each of them would be too small."""
    ratios = []
    for seed in range(200 if face_mm == 0.2 else 25):
        rng = np.random.default_rng(seed)
        offsets = drawn(rng)
        made = passes_over(rng, offsets, white_mm=white_mm, face_mm=face_mm)
        found = made.fused()
        ratios.append((left_mm(made, found, offsets) / found.sigma_mm) ** 2)
    # a region of 16 faces tells its own spread to a fifth, so that the ratios scatter more than
    # those of a sigma that is known, whose mean scatters by root 2 over root of their number
    assert 0.3 < np.mean(ratios) < 1.2 + 3.0 * np.sqrt(2.0 / len(ratios))


def test_agreement_ends_at_its_limit():
    places = np.column_stack((np.linspace(0.0, 1.0, 6), np.zeros(6)))
    for off, agrees in ((0.95 * AGREEING_MM, True), (1.05 * AGREEING_MM, False)):
        depths = np.r_[np.full(5, 6.0), 6.0 + off]
        found = fuse_passes(places, places, depths, np.ones(6, bool), np.zeros(6, np.int64))
        np.testing.assert_array_equal(found.agreeing, [True] * 5 + [agrees])


def test_a_cluster_of_shallow_echoes_at_the_edge_is_refused_by_deeper_ones_from_its_places():
    """Deep echoes of a curved bone come from up to 3 mm aside, shallow ones from right below."""
    u, v = np.meshgrid(np.arange(-20.0, 20.5), np.arange(-20.0, 20.5), indexing="ij")
    entries = np.column_stack((u.ravel(), v.ravel()))
    n, edge = len(entries), entries[:, 0] < -17.0
    wrong = edge & (np.abs(entries[:, 1]) < 3.0)
    depths = np.concatenate((np.full(n, 7.5), np.full(n, 7.5), np.where(wrong, 2.6, 7.5)))
    entries = np.tile(entries, (3, 1))
    places = entries * (1.0 - 0.14 * depths / 7.5)[:, None]
    found = fuse_passes(entries, places, depths, np.ones(3 * n, bool), np.repeat(np.arange(3), n))
    assert not found.agreeing[2 * n :][wrong].any()
    assert found.agreeing[: 2 * n].all()
