"""The re-scan of the floor moves the probe: planned and certified, or the floor is not scanned."""

from dataclasses import replace

import numpy as np
import pytest

from rona_core.app.dependencies.staleness import required
from rona_core.app.steps.implant import rehearsal
from rona_core.app.steps.implant.messages import RehearseMilling
from rona_core.app.steps.implant.rehearsal import (
    FloorScan,
    derive_rehearsal,
    milling_task,
    rehearsal_ok,
    rehearsal_verdict,
)
from rona_core.app.steps.implant.view import milling_view
from rona_core.app.steps.roll.derivation import plan_settings
from rona_core.app.steps.roll.inputs import DRIVEN
from rona_core.app.steps.roll.messages import StartRollSearch
from rona_core.compose import milling_site
from rona_core.devices.protocols import never, silent
from rona_core.planning.rehearsal.milled_floor import FloorLine
from rona_core.planning.rehearsal.site import ProbeWay
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.planning.plan_motion import plan_scan
from rona_core.robot.verification.verifier import verify_scan
from rona_core.session.codec import digest
from tests.helpers.session_file import reopened
from tests.scenes import demo_parts

OVER = (0.0, 0.0, 2.0)


@pytest.fixture(scope="module")
def milled():
    return demo_parts.demo()


@pytest.fixture(scope="module")
def certified(milled):
    return rehearsed(milled)


@pytest.fixture(scope="module", params=["kept", pytest.param("made", marks=pytest.mark.slow)])
def scanned(request, milled):
    """A session whose rehearsal scanned the floor: the demo, and one rehearsed now."""
    return milled if request.param == "kept" else request.getfixturevalue("certified")[0]


def rehearsed(session):
    site = milling_site(session, 1)
    found = derive_rehearsal(session, RehearseMilling(), site, progress=silent, cancel=never)
    held = replace(session.results.more["rehearsal"], value=found)
    return session.with_result("rehearsal", held), found, site


def probe_robot(session):
    return robot_model(session.setup.devices.robot.model)


def verified(session, plan):
    settings = plan_settings(required(DRIVEN, session), StartRollSearch())
    return verify_scan(
        probe_robot(session),
        plan.trajectory,
        plan.search.path,
        plan.search.rolls_rad,
        settings.scan.scan_speed_mm_per_s,
        obstacles=settings.obstacles,
    )


def test_the_motion_is_verified_against_its_own_line_and_goes_from_home_to_home(milled, scanned):
    found = scanned.results.more["rehearsal"].value
    plan, model = found.floor_plan, probe_robot(milled)
    assert plan.may_move
    assert found.asked >= len(found.places_bed) > 10  # not every echo is sure
    assert verified(milled, plan).certified
    np.testing.assert_allclose(plan.trajectory.qs_rad[[0, -1]], [model.home_rad] * 2)
    T_base_bed = milling_view(milled).placed.T_base_bed
    path = plan.search.path
    np.testing.assert_allclose(path.axes_base, np.tile(-T_base_bed.rotation[:, 2], (len(path), 1)))
    away = path.points_base[None] - (T_base_bed @ found.places_bed)[:, None]
    assert np.linalg.norm(away, axis=2).min(axis=1).max() < 1e-6
    # it is no certificate of another floor
    deeper = replace(path, points_base=path.points_base + path.axes_base)
    other = replace(plan, search=replace(plan.search, path=deeper))
    assert not verified(milled, other).certified


def test_verdict_and_file_keep_the_motion(scanned):
    session, found = scanned, scanned.results.more["rehearsal"].value
    seconds = round(found.floor_plan.trajectory.duration_s)
    places = f"scanned again at {found.asked} places in a certified motion of {seconds} s"
    assert places in rehearsal_verdict(found)
    loaded = reopened(session)
    assert digest(loaded.results.more["rehearsal"].value) == digest(found)
    assert loaded.results.more["rehearsal"].value.floor_plan.may_move


def tampered(*args, **kwargs):
    """Plan a scan; turn one joint by half a degree, after the verifier has seen the motion."""
    plan = plan_scan(*args, **kwargs)
    qs = plan.trajectory.qs_rad + np.deg2rad((0.5, 0.0, 0.0, 0.0, 0.0, 0.0))
    return replace(plan, trajectory=replace(plan.trajectory, qs_rad=qs))


def test_along_a_motion_other_than_the_certified_one_no_place_is_touched(milled, monkeypatch):
    monkeypatch.setattr(rehearsal, "plan_scan", tampered)
    scan = FloorScan(milled)
    assert scan(FloorLine(np.array((OVER, (0.0, 0.0, -1.0), OVER)), np.array((1,)))) is None
    assert not scan.plan.may_move


@pytest.mark.slow
def test_a_motion_other_than_the_certified_one_does_not_scan(milled, certified, monkeypatch):
    monkeypatch.setattr(rehearsal, "plan_scan", tampered)
    _, found, site = rehearsed(milled)
    assert not found.floor_plan.may_move
    by_maps_alone(found, site, certified)
    assert "no motion of the probe over it is certified" in rehearsal_verdict(found)


@pytest.mark.slow
def test_where_the_probe_may_not_touch_the_floor_is_not_scanned_and_the_reason_is_told(
    milled, certified, monkeypatch
):
    """The planted fault: a head that the delay line has to keep away from like all else."""

    def untouched(driven, message):
        settings = plan_settings(driven, message)
        return replace(settings, obstacles=settings.obstacles.without_touch())

    monkeypatch.setattr(rehearsal, "plan_settings", untouched)
    session, found, site = rehearsed(milled)
    assert found.floor_plan.trajectory is None
    by_maps_alone(found, site, certified)
    said = rehearsal_verdict(found)
    assert "the floor could not be scanned again, as no motion of the probe over it is" in said
    assert "rolls works" in said
    assert "by blocked" in said
    loaded = reopened(session)
    assert rehearsal_verdict(loaded.results.more["rehearsal"].value) == said


def by_maps_alone(found, site, certified):
    """Assert that a rehearsal went on without the scan that another one had."""
    assert (found.asked, len(found.scans), site.scanned_mm) == (0, 0, None)
    assert found.pause == certified[1].pause
    assert found.steps == len(site.least_mm) > 0
    assert found.residual_mm > 0.0
    assert not rehearsal_ok(found)


def test_the_true_face_is_where_the_postures_of_the_motion_bring_it(milled):
    scan, site, model = FloorScan(milled), milling_site(milled, 1), probe_robot(milled)
    T_base_bed = milling_view(milled).placed.T_base_bed
    places = np.array(((0.0, 0.0, -1.0), (1.5, 0.0, -1.0), (1.5, 1.5, -1.0)))
    line = FloorLine(np.vstack((OVER, places, (1.5, 1.5, 2.0))), np.array((1, 2, 3)))
    way = scan(line)
    np.testing.assert_array_equal(way.places_bed, places)
    meant = model.forward(way.qs_rad) @ model.T_flange_probe
    off = np.linalg.norm(meant.translations - T_base_bed @ places, axis=1)
    assert off.max() < 0.3  # corners are rounded
    assert (np.diff(way.times_s) > 0.0).all()
    first, last = scan.plan.trajectory.scan_start_s, scan.plan.trajectory.scan_end_s
    assert first < way.times_s[0] < way.times_s[-1] < last
    # the same places with the wrist turned round: the face as it is clamped turns with it
    site.follow(milling_task(milled, lambda pause, ceiling: None, scan).way)
    turned = replace(way, qs_rad=way.qs_rad + (0.0, 0.0, 0.0, 0.0, 0.0, 0.5))
    faces, other = site._true_probes(way), site._true_probes(turned)
    between = np.swapaxes(faces.rotations, 1, 2) @ other.rotations
    moved = model.forward(turned.qs_rad) @ model.T_flange_probe
    wanted = np.swapaxes(meant.rotations, 1, 2) @ moved.rotations
    np.testing.assert_allclose(
        np.trace(between, axis1=1, axis2=2), np.trace(wanted, axis1=1, axis2=2), atol=0.01
    )


def test_one_place_alone_is_reached_from_above_and_left_again(milled):
    scan = FloorScan(milled)
    way = scan(FloorLine(np.array((OVER, (0.0, 0.0, -1.0), OVER)), np.array((1,))))
    assert isinstance(way, ProbeWay)
    assert verified(milled, scan.plan).certified
    model = probe_robot(milled)
    face = (model.forward(way.qs_rad) @ model.T_flange_probe).translations[0]
    place = (milling_view(milled).placed.T_base_bed @ way.places_bed)[0]
    assert np.linalg.norm(face - place) < 0.3


def test_files_of_earlier_versions_have_a_scan_without_a_motion(milled):
    session, found = milled, milled.results.more["rehearsal"].value
    earlier = replace(found, floor_plan=None)
    held = replace(session.results.more["rehearsal"], value=earlier)
    loaded = reopened(session.with_result("rehearsal", held))
    assert loaded.results.more["rehearsal"].value.floor_plan is None
    said = rehearsal_verdict(earlier)
    assert f"scanned again at {found.asked} places, was measured" in said
    nowhere = replace(earlier, asked=0, scans=found.scans[:0])
    assert "the floor could not be scanned again;" in rehearsal_verdict(nowhere)
