"""Inner echoes that lean: a bone whose inner boundary is a tilted plane, scanned from above."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from rona_core.devices.samples import AScanTrack
from rona_core.devices.settings import ProbeSettings
from rona_core.geometry.pose import Pose
from rona_core.ultrasound.detection.detect import NOMINAL_SPEED_MM_PER_US, detect, nominal_bone
from rona_core.ultrasound.detection.single.candidates import clear_fronts, search_echoes
from rona_core.ultrasound.detection.spatial.candidate_selection import select_inner_echoes
from rona_core.ultrasound.detection.spatial.neighbours import LocalPlanes, scan_links
from rona_core.ultrasound.detection.spatial.oblique_correction import correct_oblique_echoes
from rona_core.ultrasound.detection.spatial.slope_likelihoods import beam_transform
from rona_core.ultrasound.probe.beam import probe_beam
from rona_core.ultrasound.probe.materials import TABLE
from rona_core.ultrasound.probe.probe_model import ProbeSurvey, probe_model
from rona_core.virtual.acoustics.medium import Medium
from rona_core.virtual.acoustics.probe import VirtualProbe
from tests.helpers.ultrasound_scenes import StillClock

PROBE = probe_model("2.25MHz")
BONE = nominal_bone()
# one kind of bone at the nominal speed: what is off is the timing alone
PURE = replace(TABLE, speed_mm_per_us=NOMINAL_SPEED_MM_PER_US)
MEDIUM = Medium(
    table=PURE, diploe=PURE, outer_roughness_mm=0.0, inner_roughness_mm=0.03, speckle=0.0
)
SIDE, PITCH_MM, DEPTH_MM = 9, 1.5, 4.5


class Wedge:
    """Outer boundary at z = 0, inner one below it on a plane that rises along x."""

    def __init__(self, slope):
        self.slope = slope

    def layers(self, origins_skull, directions_skull):
        def along(depth, slope):
            rate = directions_skull[:, 2] - slope * directions_skull[:, 0]
            return (depth + slope * origins_skull[:, 0] - origins_skull[:, 2]) / rate

        parts = [along(share * DEPTH_MM, share * self.slope) for share in (0.0, 0.3, 0.75, 1.0)]
        return np.stack(parts, axis=1)


@lru_cache(maxsize=4)
def survey(slope, excitation, lean_deg=0.0):
    """Return A-scans on a grid, where the probe stood, its axes, and true standoff and depth."""
    clock, pose = StillClock(), [Pose.identity()]
    probe = VirtualProbe(clock, lambda times: pose[0].repeated(len(times)), Wedge(slope), MEDIUM)
    settings = ProbeSettings(name="2.25MHz", excitation=excitation, front_snr_db=50.0, shots=1)
    probe.begin(settings, 7, 0)
    x, y = np.meshgrid(*[(np.arange(SIDE) - SIDE // 2) * PITCH_MM] * 2, indexing="ij")
    places = np.column_stack((x.ravel(), y.ravel(), np.full(x.size, -0.1)))
    turn = Pose.from_rotvec((0.0, np.deg2rad(lean_deg), 0.0), np.zeros(3)).rotation
    scans = []
    for number, place in enumerate(places):
        clock.time_s = 0.1 * number
        pose[0] = Pose(turn, place)
        scans.append(probe.acquire())
    axes = np.broadcast_to(turn[:, 2], places.shape)
    found = Wedge(slope).layers(places, axes)
    return AScanTrack.from_scans(scans), places, axes, found[:, 0], found[:, 3] - found[:, 0]


def error_mm(choice, depth):
    ok = choice.detected & (choice.confidence > 0.5)
    return (choice.lag_us * NOMINAL_SPEED_MM_PER_US / 2.0 - depth)[ok]


def rms(values):
    """Return the RMS; of nothing it is infinite: all was refused."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else np.inf


def selected(scans):
    """Return the echoes of a survey, its links, and the inner echoes before the correction."""
    echoes = search_echoes(clear_fronts(scans), BONE)
    links = scan_links(scans.positions_mm, len(scans))
    return echoes, links, select_inner_echoes(echoes, BONE, links)


def corrected(slope, excitation, lean_deg=0.0, *, known=False):
    """Return the errors before and after, in mm."""
    track, places, axes, standoff, depth = survey(slope, excitation, lean_deg)
    at = standoff if known else None
    scans = ProbeSurvey(track, PROBE, excitation, places, axes, at)
    echoes, links, choice = selected(scans)
    again = correct_oblique_echoes(echoes, choice, BONE, scans, links)
    depth = depth * (1.0 - (0.0 if lean_deg else slope) ** 2)  # the way back is shorter by as much
    return error_mm(choice, depth), error_mm(again, depth)


@pytest.mark.sweep(1)
@pytest.mark.parametrize("slope", [0.16, 0.18])
def test_a_leaning_table_is_a_cycle_off_before_and_right_afterwards(slope):
    before, after = corrected(slope, "chirp")
    assert len(after) > 0.9 * SIDE**2
    assert np.median(before) > 0.4  # the far edge of the beam, all over the survey
    assert np.abs(after).max() < 0.1
    assert np.abs(after.mean()) < 0.05


@pytest.mark.sweep(2)
@pytest.mark.parametrize("excitation", ["pulse", "chirp"])
@pytest.mark.parametrize("slope", [0.0, 0.05, 0.1])
def test_a_time_that_was_right_stays_right(slope, excitation):
    before, after = corrected(slope, excitation)
    assert len(after) > 0.9 * SIDE**2
    assert rms(after) < rms(before) + 0.003
    assert np.abs(after).max() < 0.05


def test_a_probe_that_leans_with_the_table_sees_no_wedge():
    _, after = corrected(0.15, "chirp", -5.0, known=True)
    assert len(after) > 0.9 * SIDE**2
    assert np.abs(after).max() < 0.05


def test_the_lean_of_the_probe_counts_like_that_of_the_table():
    track, places, axes, standoff, depth = survey(0.1, "chirp", 3.0)
    scans = ProbeSurvey(track, PROBE, "chirp", places, axes, standoff)
    echoes, links, choice = selected(scans)
    told, untold = (
        rms(
            error_mm(
                correct_oblique_echoes(echoes, choice, BONE, replace(scans, axes=a), links), depth
            )
        )
        for a in (axes, None)
    )
    assert told < 0.12
    assert told < 0.5 * untold
    assert told < 0.7 * rms(error_mm(choice, depth))


def test_a_rigid_motion_of_the_frame_changes_nothing():
    track, places, axes, _, _ = survey(0.14, "chirp")
    scans = ProbeSurvey(track, PROBE, "chirp", places, axes)
    echoes, links, choice = selected(scans)
    moved = Pose.from_rotvec((0.4, -1.1, 0.7), (30.0, -200.0, 650.0))
    here = correct_oblique_echoes(echoes, choice, BONE, scans, links)
    turned = replace(scans, positions_mm=moved @ places, axes=moved.rotate(axes))
    there = correct_oblique_echoes(echoes, choice, BONE, turned, links)
    np.testing.assert_allclose(there.lag_us, here.lag_us, atol=1e-6)
    np.testing.assert_allclose(there.sigma_us, here.sigma_us, atol=1e-6)


def test_no_echo_becomes_surer_and_those_not_heard_stay_as_they_are():
    track, places, axes, _, _ = survey(0.14, "chirp")
    scans = ProbeSurvey(track, PROBE, "chirp", places, axes)
    echoes, links, choice = selected(scans)
    deaf = np.arange(len(places)) % 3 == 0
    choice = replace(choice, detected=choice.detected & ~deaf)
    again = correct_oblique_echoes(echoes, choice, BONE, scans, links)
    np.testing.assert_array_equal(again.lag_us[deaf], choice.lag_us[deaf])
    np.testing.assert_array_equal(again.sigma_us[deaf], choice.sigma_us[deaf])
    assert (again.confidence <= choice.confidence + 1e-12).all()
    assert (again.sigma_us[again.detected] > 0.0).all()


def test_where_nothing_leans_and_the_echo_says_nothing_the_time_is_held():
    track, places, axes, _, _ = survey(0.0, "chirp", 0.0)
    scans = ProbeSurvey(track, PROBE, "chirp", places, axes)
    echoes, links, choice = selected(scans)
    random = np.random.default_rng(5)
    part = random.normal(size=(2, *echoes.aligned.shape))
    size = np.sqrt(np.mean(np.abs(echoes.aligned) ** 2)) / 10.0
    silent = replace(echoes, aligned=size * (part[0] + 1j * part[1]))
    again = correct_oblique_echoes(silent, choice, BONE, scans, links)
    ok = choice.detected & (choice.confidence > 0.5)
    moved = (again.lag_us - choice.lag_us)[ok] * PROBE.centre_mhz
    assert rms(moved) < 0.35
    assert np.median(again.sigma_us[ok] * PROBE.centre_mhz) > 0.2  # and it says so


def test_too_few_to_ask_are_left_alone():
    track, places, axes, _, _ = survey(0.14, "chirp")
    few = replace(track, rf=track.rf[:5], times_s=track.times_s[:5], clipped=track.clipped[:5])
    scans = ProbeSurvey(few, PROBE, "chirp", places[:5], axes[:5])
    echoes, links, choice = selected(scans)
    assert correct_oblique_echoes(echoes, choice, BONE, scans, links) is choice


def test_detection_uses_it_where_it_knows_the_places():
    track, places, axes, _, depth = survey(0.14, "chirp")
    found = detect(ProbeSurvey(track, PROBE, "chirp", positions_mm=places, axes=axes))
    ok = found.inner_ok
    assert ok.mean() > 0.8
    off_mm = (found.thickness_mm - depth * (1.0 - 0.14**2))[ok]
    assert np.abs(off_mm).max() < 0.1
    assert rms(off_mm / found.thickness_sigma_mm[ok]) < 1.5


def test_the_transform_of_the_beam_is_that_of_its_rays():
    frequencies = np.array([1.5, 2.25, 3.0])
    found = beam_transform(PROBE, frequencies, np.array([0.0, 0.05, 0.11]))
    np.testing.assert_allclose(found[0], 1.0, atol=1e-12)
    beam = probe_beam(PROBE)
    k = int(np.argmin(np.abs(beam.frequencies_mhz - 2.25)))
    f, weights = beam.frequencies_mhz[k], beam.weights[:, k]
    # a wedge turned about the probe's axis: only its slope counts
    turned = beam.points_mm @ np.array((np.cos(0.7), np.sin(0.7)))
    brute = np.sum(weights * np.exp(-2j * np.pi * f * 0.11 * turned)) / weights.sum()
    np.testing.assert_allclose(
        beam_transform(PROBE, np.array([f]), np.array([0.11]))[0, 0], brute, atol=5e-3
    )


def test_a_plane_is_found_and_a_stranger_among_the_neighbours_is_not_believed():
    rng = np.random.default_rng(3)
    places = rng.uniform(0.0, 12.0, (150, 2))
    values = 4.0 + places @ np.array((0.09, -0.05))
    strange = values.copy()
    strange[::12] += 0.44
    around = LocalPlanes(places)
    assert around.known.all()
    for given in (values, strange):
        expected, rise, _ = around.planes(given, np.full(150, 0.02))
        np.testing.assert_allclose(expected, values, atol=2e-3)
        np.testing.assert_allclose(rise, np.broadcast_to((0.09, -0.05), rise.shape), atol=2e-3)


def test_a_place_without_neighbours_knows_of_none():
    places = np.vstack((np.random.default_rng(4).uniform(0, 6, (40, 2)), [[90.0, 90.0]]))
    around = LocalPlanes(places)
    assert around.known[:-1].all()
    assert not around.known[-1]
