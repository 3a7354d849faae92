"""How sure the maps are: against the truth, whole and part by part, and never out of a file."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.reference.map_coverage import bands, parts, within
from rona_core.app.steps.acoustics.view import speed_of_maps
from rona_core.app.steps.boundaries.ascan_view import ascan_plot
from rona_core.app.steps.boundaries.messages import CorrectBoundary
from rona_core.app.steps.maps.inputs import ROBOT_PLACE, TERMS, map_accuracy
from rona_core.app.steps.maps.view import layers_of
from rona_core.mapping.accuracy.echo_terms import (
    NO_FRONT_ECHO,
    NO_INNER_ECHO,
    ROUGHNESS,
    no_echo_term,
    no_front_echo_term,
)
from rona_core.mapping.accuracy.error_terms import ErrorTerm
from rona_core.mapping.accuracy.map_accuracy import accuracy_words
from rona_core.mapping.accuracy.map_terms import BETWEEN_PASSES
from rona_core.mapping.accuracy.probe_place import (
    ROOM_K,
    WARMING_K,
)
from rona_core.robot.kinematics.link_errors import ROBOT_ACCURACY_MM
from rona_core.session.codec import digest
from rona_core.session.document import Derived, Session, SonoMaps
from rona_core.ultrasound.acoustic_calibration.speed_calibration import (
    calibrate_speed,
    speed_uncertainty,
    uncalibrated,
)
from rona_core.ultrasound.acoustic_calibration.speed_prior import LOCAL_SHARE, PATIENTS_SHARE
from tests.scenes.demo_parts import without_reference_points


@pytest.fixture(scope="module")
def demo():
    return without_reference_points()


@pytest.fixture(scope="module")
def accuracy(demo):
    return map_accuracy(demo)


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def test_the_budget_of_each_map_is_the_sum_of_its_causes(demo, accuracy):
    maps = demo.results.maps.value
    both = maps.inner.ok & maps.outer.ok
    for part, ok in ((accuracy.outer, maps.outer.ok), (accuracy.thickness, both)):
        whole = rms(part.total_mm()[ok])
        assert whole == pytest.approx(sum(row.sigma_mm**2 for row in part.budget) ** 0.5)
        sizes = [row.sigma_mm for row in part.budget]
        assert sizes == sorted(sizes, reverse=True)
    causes = {row.cause: row for row in accuracy.outer.budget}
    assert {cause for cause, row in causes.items() if row.of_robot} == {"links of the robot"}
    assert causes["mounting of the probe"].sigma_mm < 0.03
    of_bone = {row.cause for row in accuracy.thickness.budget}
    assert ROUGHNESS in of_bone
    carried = set(causes) - of_bone - {NO_FRONT_ECHO}
    inner = {row.cause for row in accuracy.inner.budget}
    assert inner == carried | of_bone - {ROUGHNESS}


def test_without_the_gauge_plate_the_mounting_is_the_largest_cause(demo):
    largest = map_accuracy(demo.with_result("mounting", None)).outer.budget[0]
    assert largest.cause == "mounting of the probe"
    assert largest.own_mm == 0.0 < largest.shared_mm
    assert "gauge plate" in largest.remedy


def test_a_line_that_warms_with_the_root_of_time_is_off_by_its_mean_and_spread(demo):
    warmth_k = WARMING_K * np.sqrt(np.linspace(0.0, 1.0, 100_001))  # from the gauge to the end
    with_gauge, without = (
        next(term for term in ROBOT_PLACE.read(session).terms if term.cause == "delay line")
        for session in (demo, demo.with_result("mounting", None))
    )
    mm_per_k = without.shared_mm / ROOM_K
    assert with_gauge.shared_mm == pytest.approx(warmth_k.mean() * mm_per_k, rel=1e-4)
    assert with_gauge.own_mm == pytest.approx(warmth_k.std() * mm_per_k, rel=1e-4)


def test_bands_of_95_percent_hold_the_truth(demo):
    found = dict(bands(demo))
    assert set(found) == {
        "thickness", "outer", "inner", "fused", "outer_same_robot", "inner_same_robot",
        "fused_same_robot",
    }  # fmt: skip
    for name, band in found.items():
        assert within(band.errors_mm, band.total_mm) > 0.85, name
        # wide enough, and no wider: a band of a metre holds everything
        size = np.sqrt(np.mean(band.total_mm**2) / np.mean(band.errors_mm**2))
        assert 0.5 < size < 3.0, name
    for name in ("thickness", "inner"):
        band = found[name]
        rest = band.errors_mm - band.errors_mm.mean()
        assert within(rest, band.own_mm) > 0.85
        assert abs(band.errors_mm.mean()) < 1.96 * band.shared_mm


def test_the_parts_add_up_and_the_robot_counts_where_another_uses_the_map(demo, accuracy):
    maps = demo.results.maps.value
    for part in (accuracy.outer, accuracy.inner, accuracy.fused):
        robot = np.hypot(part.robot_own_mm, part.robot_shared_mm)
        np.testing.assert_allclose(part.total_mm(), np.hypot(part.same_robot_mm(), robot))
        # what the maker states in 3D, along the normal; most of it alike in the whole map
        assert rms(robot[maps.outer.ok]) == pytest.approx(ROBOT_ACCURACY_MM / 3.0**0.5, rel=0.4)
        assert rms(part.robot_own_mm[maps.outer.ok]) < 0.5 * rms(part.robot_shared_mm)
    bone, inner, outer = accuracy.thickness, accuracy.inner, accuracy.outer
    assert not bone.robot_own_mm.any()
    assert not bone.robot_shared_mm.any()
    # what front echoes err by moves the thickness, not the inner boundary
    terms = TERMS.read(demo)
    for ways in ("own_mm", "shared_mm"):
        fronts = (*terms.front, terms.no_front_echo)
        of_front = sum(np.square(getattr(term, ways)) for term in fronts)
        rough = np.square(getattr(terms.rough, ways))
        parts_mm2 = [np.square(getattr(part, ways)) for part in (bone, outer, inner)]
        carried = parts_mm2[1] - of_front - rough
        np.testing.assert_allclose(parts_mm2[2], parts_mm2[0] - rough + carried, atol=1e-12)
    both = maps.inner.ok & maps.outer.ok
    of_mean = {row.cause: row.shared_mm for row in bone.budget}
    rest_mm2 = sum(
        of_mean[cause] ** 2 for cause in ("time of flight", "interpolation", BETWEEN_PASSES)
    )
    assert 0.0 < rest_mm2 < 0.5 * rms(bone.own_mm[both]) ** 2
    (silent_around,) = [t for t in TERMS.read(demo).thickness if t.cause == NO_INNER_ECHO]
    rest_mm2 = rest_mm2 + np.broadcast_to(silent_around.shared_mm, both.shape)[both] ** 2
    share = np.sqrt(bone.shared_mm[both] ** 2 - rest_mm2) / maps.thickness_mm()[both]
    np.testing.assert_allclose(share, share[0], rtol=1e-6)  # one for the whole map
    assert PATIENTS_SHARE < share[0] < np.hypot(PATIENTS_SHARE, LOCAL_SHARE)  # nobody told it
    for part in (outer, inner, accuracy.fused, bone):
        assert part.own_mm.shape == maps.outer.height_mm.shape
        assert not part.own_mm.flags.writeable


def test_a_place_is_less_sure_the_farther_the_nearest_sample_is(demo, accuracy):
    maps = demo.results.maps.value
    u, v = np.meshgrid(maps.inner.u_mm, maps.inner.v_mm, indexing="ij")
    samples = maps.inner.T_base_map.inv() @ maps.inner_points_base[maps.inner_used]
    away = np.hypot(u[..., None] - samples[:, 0], v[..., None] - samples[:, 1]).min(axis=-1)
    depth = maps.thickness_mm()
    cells_map = np.column_stack((u.ravel(), v.ravel(), maps.outer.height_mm.ravel()))
    cells_base = maps.outer.T_base_map @ cells_map
    ok = (maps.inner.ok & maps.outer.ok).ravel()
    of_place = speed_uncertainty(uncalibrated(), cells_base, cells_base[ok])[1]
    by_speed = of_place.reshape(depth.shape) * depth
    own = np.sqrt(np.maximum(accuracy.thickness.own_mm**2 - by_speed**2, 0.0))
    near, far = (away < 0.5) & maps.inner.ok, (away > 2.0) & maps.inner.ok
    assert np.median(own[far]) > 1.1 * np.median(own[near])


def test_reference_points_make_it_surer_once_the_maps_were_made_with_them(demo, accuracy):
    maps = demo.results.maps
    places = maps.value.outer_points_base[maps.value.outer_used][::60]
    depth = np.full(len(places), 6.0)
    known = calibrate_speed(depth, 2.0 * depth / 2.6, positions_mm=places)
    results = replace(demo.results, speed=Derived(known, "CalibrateSoundSpeed", {}, {}))
    calibrated = replace(demo, results=results)
    assert map_accuracy(calibrated) is accuracy  # the maps know nothing of it yet
    made = replace(maps, inputs={**maps.inputs, "speed": digest(known)})
    after = map_accuracy(replace(calibrated, results=replace(results, maps=made)))
    ok = maps.value.inner.ok
    assert np.median(after.thickness.shared_mm[ok] / accuracy.thickness.shared_mm[ok]) < 0.8
    assert (after.thickness.own_mm[ok] < accuracy.thickness.own_mm[ok]).all()
    np.testing.assert_array_equal(after.outer.own_mm, accuracy.outer.own_mm)


def test_maps_by_hand_know_the_speed_that_they_were_made_with_in_base_alone(demo):
    known = calibrate_speed(np.full(3, 6.0), np.full(3, 4.6))
    speed = Derived(known, "CalibrateSoundSpeed", {}, {})
    for frame, expected in (("base", known), ("basemarker", None)):
        made = SonoMaps(demo.results.maps.value, frame, 1, 1, 0.0, "")
        maps = Derived(made, "StartHandheldMapping", {}, {"speed": digest(known)})
        session = replace(demo, results=replace(demo.results, speed=speed, sono_maps=maps))
        assert speed_of_maps(session, hand=True) is expected
        assert speed_of_maps(session) is None  # those of the robot know nothing of it


def test_a_boundary_set_by_hand_is_as_sure_as_an_eye(demo, accuracy):
    maps, found = demo.results.maps.value, demo.results.detection.value
    used = np.flatnonzero(maps.inner_used[: len(found)])
    i = int(used[np.argmin(found.thickness_sigma_mm[used])])
    time_us = float(found.inner_us[i])
    edit = CorrectBoundary(i, inner_us=time_us).edit()
    after = map_accuracy(replace(demo, boundary_edits=demo.boundary_edits.put(edit)))
    cell = maps.inner.T_base_map.inv() @ maps.inner_points_base[i]
    at = np.argmin(np.abs(maps.inner.u_mm - cell[0])), np.argmin(np.abs(maps.inner.v_mm - cell[1]))
    assert after.thickness.own_mm[at] > accuracy.thickness.own_mm[at]


def test_an_outer_boundary_set_by_hand_tells_nothing_of_how_rough_the_bone_is(demo):
    used = np.flatnonzero(demo.results.maps.value.outer_used[: len(demo.results.detection.value)])
    found = demo.results.detection.value
    i = int(used[np.argmin(found.outer_quality[used])])
    edit = CorrectBoundary(i, outer_us=float(found.outer_us[i])).edit()
    after = TERMS.read(replace(demo, boundary_edits=demo.boundary_edits.put(edit)))
    before = TERMS.read(demo)
    assert np.array_equal(after.rough.own_mm, before.rough.own_mm)
    assert not np.array_equal(after.front[0].own_mm, before.front[0].own_mm)
    assert np.ptp(before.rough.own_mm) > 0.01


def test_of_other_ascans_than_those_of_the_maps_nothing_is_said(demo):
    results = demo.results
    gone = replace(demo, results=replace(results, second_detection=None))
    assert results.second_detection is not None
    assert map_accuracy(gone) is None
    assert map_accuracy(Session()) is None
    assert map_accuracy(demo, hand=True) is None  # nobody scanned by hand


def test_the_sentence_says_the_size_of_each_error(demo, accuracy):
    words = accuracy_words(demo.results.maps.value, accuracy)
    maps = demo.results.maps.value
    rms = np.sqrt(np.mean(accuracy.outer.total_mm()[maps.outer.ok] ** 2))
    assert f"outer boundary {rms:.2f} mm" in words
    assert rms > 0.2
    both = maps.outer.ok & maps.inner.ok
    rms = np.sqrt(np.mean(accuracy.thickness.total_mm()[both] ** 2))
    assert f"thickness {rms:.2f} mm" in words


def test_maps_are_coloured_by_it(demo, accuracy):
    maps = demo.results.maps.value
    layers = layers_of(maps, "sigma", accuracy)
    for name in ("outer", "inner", "fused"):
        boundary, part = getattr(maps, name), layers.part(name)
        np.testing.assert_array_equal(
            part.values_mm, getattr(accuracy, name).total_mm()[boundary.ok]
        )
    assert 0.15 <= layers.low_mm < layers.high_mm < 1.0
    assert not len(layers_of(maps, "sigma").outer.values_mm)  # nobody knows
    own, common = (layers_of(maps, f"sigma_{part}", accuracy) for part in ("own", "common"))
    for name in ("outer", "inner", "fused"):
        both = np.hypot(own.part(name).values_mm, common.part(name).values_mm)
        np.testing.assert_allclose(both, layers.part(name).values_mm)
    thickness = layers_of(maps, "sigma_thickness", accuracy)
    ok = maps.outer.ok & maps.inner.ok
    np.testing.assert_array_equal(thickness.outer.values_mm, accuracy.thickness.total_mm()[ok])


def test_an_ascan_states_the_thickness_with_the_speed_of_sound_in_it(demo):
    found = demo.results.detection.value
    i = int(np.argmax(np.where(found.inner_ok, found.thickness_mm, 0.0)))
    told = float(ascan_plot(demo, i).remark.split("±")[1].split("mm")[0])
    speed = np.hypot(PATIENTS_SHARE, LOCAL_SHARE) * found.thickness_mm[i]
    assert told == pytest.approx(np.hypot(found.thickness_sigma_mm[i], speed), abs=0.006)
    assert told > 1.3 * found.thickness_sigma_mm[i]


def test_bone_is_less_sure_the_more_of_the_places_around_it_nobody_heard(demo):
    """Against every cell's own weighted count, place by place."""
    maps = demo.results.maps.value
    (term,) = [t for t in TERMS.read(demo).thickness if t.cause == NO_INNER_ECHO]
    ascans = (maps.inner.T_base_map.inv() @ maps.outer_points_base)[:, :2]
    heard: dict[tuple[int, int], bool] = {}  # by places 1 mm wide
    for place, was in zip(np.rint(ascans).astype(int).tolist(), maps.inner_used, strict=True):
        heard[tuple(place)] = heard.get(tuple(place), False) or bool(was)
    places, silent = np.array(list(heard)), ~np.array(list(heard.values()))
    assert 0 < np.count_nonzero(silent) < len(silent)
    for i, j in np.argwhere(maps.inner.ok)[::97]:
        away = np.linalg.norm(places - (maps.inner.u_mm[i], maps.inner.v_mm[j]), axis=1)
        weights = np.exp(-0.5 * (away / 2.0) ** 2)
        both = np.hypot(term.own_mm[i, j], term.shared_mm[i, j])
        assert both == pytest.approx(0.45 * weights[silent].sum() / weights.sum(), abs=0.002)
        assert term.shared_mm[i, j] == pytest.approx(0.379 * both, rel=0.01)  # to one side
    counted = term.own_mm[maps.inner.ok & maps.outer.ok]
    assert counted.min() < 0.02 < 0.2 < counted.max() < 0.45


def test_the_outer_boundary_is_less_sure_where_no_front_echo_tells_of_it(demo):
    made = demo.results.maps
    maps, n = made.value, len(demo.results.detection.value)
    T_map_base = maps.outer.T_base_map.inv()
    places = (T_map_base @ maps.outer_points_base[:n])[:, :2]
    groove = np.abs(places[:, 0]) < 3.0
    every, used = (np.ones(len(maps.outer_used), dtype=np.bool_) for _ in range(2))
    used[:n][groove] = False
    term = no_front_echo_term(replace(maps, outer_used=used), T_map_base, n)
    in_it = np.abs(maps.outer.u_mm) < 1.0
    beside = np.abs(maps.outer.u_mm) > 9.0
    ok = maps.outer.ok
    assert term.own_mm[in_it][ok[in_it]].min() > 0.2
    assert term.own_mm[in_it][ok[in_it]].max() <= 0.3
    assert term.own_mm[beside][ok[beside]].max() < 0.01
    assert not no_front_echo_term(replace(maps, outer_used=every), T_map_base, n).own_mm.any()


def test_a_place_counts_as_heard_however_many_ascans_there_heard_nothing(demo):
    """So a further pass that hears nothing leaves the map as sure as it was."""
    maps = demo.results.maps.value
    before = no_echo_term(maps, maps.inner.T_base_map.inv())
    again = replace(
        maps,
        outer_points_base=np.vstack((maps.outer_points_base, maps.outer_points_base)),
        inner_used=np.concatenate((maps.inner_used, np.zeros_like(maps.inner_used))),
    )
    after = no_echo_term(again, maps.inner.T_base_map.inv())
    np.testing.assert_array_equal(after.own_mm, before.own_mm)


def test_the_mean_over_cells_feels_the_mean_of_what_they_share():
    """Against draws of a cause that three cells of four do not feel."""
    shared = np.zeros((20, 20))
    shared[:10, :10] = 0.3
    terms = (ErrorTerm("a", 0.1, shared), ErrorTerm("b", 0.0, 0.05))
    own, of_mean = parts(terms, np.ones((20, 20), dtype=np.bool_))
    generator = np.random.default_rng(0)
    one, other = generator.standard_normal((2, 4000, 1))
    errors = shared.ravel() * one + 0.05 * other + 0.1 * generator.standard_normal((4000, 400))
    means = errors.mean(axis=1)
    assert of_mean == pytest.approx(means.std(), rel=0.05)
    np.testing.assert_allclose((errors - means[:, None]).std(axis=0), own, rtol=0.06)
