"""The echo volume of a session: it agrees with the maps, and is refused where they do not count."""

from dataclasses import replace

import numpy as np
import pytest

from rona_core.app.runtime.session_step import Undo
from rona_core.app.steps.boundaries.messages import CorrectBoundary
from rona_core.app.steps.maps.messages import StartMapping
from rona_core.app.steps.maps.volume import (
    echo_volume,
    scan_lines,
    volume_agreement,
    volume_surface,
)
from rona_core.app.steps.setup.messages import SetProbe
from rona_core.compose import new_workbench
from rona_core.errors import InvalidInputError, StaleResultError, StepBlockedError
from rona_core.mapping.volume.inner_ridge import GAIN_DB_PER_MM
from rona_core.session.document import Session


def test_thickness_read_from_the_volume_is_that_of_the_inner_map(demo):
    agreement = volume_agreement(demo)
    assert agreement is not None
    assert agreement.share > 0.55
    assert agreement.columns > 900
    assert abs(agreement.median_mm) < 0.08
    # the strongest ridge is that of the step to the diploe in some columns
    assert agreement.median_abs_mm < 0.25


def test_the_front_ridge_lies_on_the_outer_map(demo):
    volume, maps = echo_volume(demo), demo.results.maps.value
    assert volume.outer is maps.outer
    assert volume.amplitude.dtype == np.float32
    near = np.abs(volume.depths_mm()) < 1.5
    front = volume.z_mm[np.argmax(np.where(near, volume.amplitude, 0.0), axis=2)]
    off = (front - maps.outer.height_mm)[maps.outer.ok & volume.measured.any(axis=2)]
    assert abs(np.median(off)) < 0.1
    assert np.percentile(np.abs(off), 95.0) < 0.4


def test_lines_are_those_of_the_maps_at_their_places_and_speeds(demo):
    lines, maps = scan_lines(demo), demo.results.maps.value
    n, found = len(demo.captures.scan.scans), demo.results.detection.value
    kept = maps.outer_used[:n]
    np.testing.assert_array_equal(
        lines.outer_points_base[: kept.sum()], maps.outer_points_base[:n][kept]
    )
    assert len(lines.profiles) > kept.sum()  # those of the second pass are there, too
    sure = found.inner_ok[kept]
    lag_us = (found.inner_us - found.outer_us)[kept]
    inner = (
        lines.outer_points_base[: kept.sum()]
        + (0.5 * lag_us * lines.speeds_mm_per_us[: kept.sum()])[:, None]
        * lines.axes_base[: kept.sum()]
    )
    # the maps move each pass by what it is off as a whole
    within = 1e-9 + abs(maps.offsets_mm[0])
    np.testing.assert_allclose(inner[sure], maps.inner_points_base[:n][kept][sure], atol=within)


def test_it_is_computed_once(demo):
    assert echo_volume(demo) is echo_volume(demo)
    assert volume_surface(demo, -30.0, GAIN_DB_PER_MM) is volume_surface(
        demo, -30.0, GAIN_DB_PER_MM
    )


def test_the_iso_surface_has_an_outer_and_an_inner_sheet(demo):
    found = volume_surface(demo, -30.0, GAIN_DB_PER_MM)
    assert len(found) > 10_000
    thickness = np.median(demo.results.maps.value.thickness_mm())
    assert (np.abs(found.depths_mm) < 1.5).mean() > 0.1
    assert (np.abs(found.depths_mm - thickness) < 2.0).mean() > 0.1
    with pytest.raises(InvalidInputError, match="dB"):
        volume_surface(demo, 3.0)


def test_without_a_scan_or_maps_it_is_blocked(demo):
    with pytest.raises(StepBlockedError, match="scan"):
        echo_volume(Session())
    with pytest.raises(StepBlockedError, match="compute the maps"):
        echo_volume(demo.with_result("maps", None))
    with pytest.raises(StepBlockedError, match="detect the boundaries"):
        echo_volume(demo.with_result("detection", None))


def test_stale_maps_are_refused_until_they_are_made_again(demo):
    bench = new_workbench(demo)
    try:
        bench.dispatch(CorrectBoundary(0, remove="inner"))
        with pytest.raises(StaleResultError, match="stale"):
            echo_volume(bench.session)
        bench.dispatch(Undo())
        echo_volume(bench.session)
        bench.dispatch(SetProbe(name="1MHz"))
        with pytest.raises(StaleResultError, match="stale"):
            echo_volume(bench.session)
    finally:
        bench.close()


@pytest.mark.slow
def test_a_boundary_that_was_set_by_hand_moves_its_a_scan(demo):
    number = int(np.flatnonzero(demo.results.detection.value.inner_ok)[5])
    found = demo.results.detection.value
    later = float(found.outer_us[number]) + 0.1
    bench = new_workbench(demo)
    try:
        bench.dispatch(CorrectBoundary(number, outer_us=later))
        bench.run(StartMapping())
        edited = bench.session
    finally:
        bench.close()
    assert echo_volume(edited) is echo_volume(edited)
    lines, kept = scan_lines(edited), edited.results.maps.value.outer_used
    assert kept[number]  # so little that it still agrees with those around
    row = int(kept[:number].sum())
    moved = lines.outer_points_base[row] - demo.results.maps.value.outer_points_base[number]
    assert moved @ lines.axes_base[row] == pytest.approx(0.1 * 1.5 / 2.0, abs=0.02)


def test_maps_of_other_a_scans_are_refused(demo):
    derived = demo.results.maps
    fewer = replace(derived.value, outer_used=derived.value.outer_used[:-1])
    with pytest.raises(StaleResultError, match="map the boundaries again"):
        echo_volume(demo.with_result("maps", replace(derived, value=fewer)))
