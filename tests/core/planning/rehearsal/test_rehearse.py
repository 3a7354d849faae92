"""A whole rehearsal at a site whose bone is a plate: measured, put right, stopped, cancelled."""

from dataclasses import replace

import numpy as np
import pytest

from rona_core.devices.samples import AScanTrack
from rona_core.errors import CancelledError
from rona_core.geometry.pose import Pose
from rona_core.planning.rehearsal.rehearse import Guards, MillingTask, rehearse
from rona_core.planning.rehearsal.site import BurrWay, ForceReading, ProbeWay

MAPPED_MM, LIMIT_MM = -5.0, 1.0  # height of the inner boundary by the maps
DEPTHS = (-0.5, -1.0, -1.5, -2.0, -2.5, -3.0, -3.5)
RADIUS_MM, BED_MM, STEP_MM = 2.5, 8.0, 0.25
DRAWS = 200
OFF = np.random.default_rng(5).normal(0.0, 0.3, DRAWS)  # the maps may all be off by these


def bed_way(depths=DEPTHS):
    """Return rings of a round bed, layer by layer."""
    rings = []
    for radius in np.arange(0.6, BED_MM - RADIUS_MM + 0.5, 1.0):
        turns = np.arange(0.0, 2.0 * np.pi, STEP_MM / radius)
        rings.append(radius * np.column_stack((np.cos(turns), np.sin(turns))))
    flat = np.concatenate(rings)
    n, layers = len(flat) * len(depths), np.repeat(np.arange(len(depths)), len(flat))
    places = np.column_stack((np.tile(flat, (len(depths), 1)), np.asarray(depths)[layers]))
    return BurrWay(
        Pose.identity(),
        places,
        np.full(n, RADIUS_MM),
        np.zeros((n, 6)),
        np.arange(n) * 0.06,
        np.full(n, 4.0),
        layers,
    )


class Plate:
    """Bone down to a height; force goes with what the burr has in bone there."""

    def __init__(self, inner_mm):
        self.inner_mm, self.lowest_mm, self.scanned = inner_mm, 0.0, 0

    def follow(self, way):
        self.way, self.row = way, 0

    def advance(self, feed_mm_per_s):
        low = float(self.way.bottoms_bed[self.row, 2])
        self.row += 1
        self.lowest_mm = min(self.lowest_mm, low)
        in_bone = min(max((low + 0.5 - self.inner_mm) / 0.5, 0.0), 1.0)
        return ForceReading(2.0 * in_bone * (feed_mm_per_s / 4.0) ** 0.5, 0.1 + 0.2 * in_bone)

    def scan_floor(self, way):
        self.scanned = len(way.places_bed)
        self.places, self.scan_times_s = way.places_bed, way.times_s
        n = self.scanned
        return AScanTrack(np.arange(n) * 0.02, np.zeros((n, 4)), np.zeros(n, np.bool_), 50.0, 0.0)

    def measure(self, track, places_bed):
        measured = places_bed[:, 2] - self.inner_mm
        n = len(measured)
        return measured, np.full(n, 0.05), np.ones(n, dtype=np.bool_), 0.01


def clamped(way):
    """Return what raises a way without a robot: it has all postures."""

    def raised(pause, ceiling):
        left = way.part(way.layers > pause)
        bottoms = left.bottoms_bed.copy()
        bottoms[:, 2] = np.maximum(bottoms[:, 2], ceiling)
        return replace(left, bottoms_bed=bottoms)

    return raised


def pressed(line):
    """Return what scans a floor without a robot: it has all postures."""
    n = len(line.stops)
    return ProbeWay(line.places_bed, np.zeros((n, 6)), np.arange(n) * 0.1)


def task(way=None, mapped_mm=MAPPED_MM, raised=None, floor_scan=pressed):
    way = way or bed_way()

    def mapped(places_bed):
        left = places_bed[:, 2] - mapped_mm
        return left, left[:, None] + OFF

    return MillingTask(
        way=way,
        mapped=mapped,
        along_axis=mapped,
        outer_mm=lambda places: np.zeros(len(places)),
        raised=raised or clamped(way),
        floor_scan=floor_scan,
        limit_mm=LIMIT_MM,
        probability=0.99,
        face_radius_mm=3.0,
        resolved_mm=2.0,
    )


def test_a_thinner_bone_is_heard_and_the_last_layers_end_higher():
    site = Plate(MAPPED_MM + 0.9)
    outcome = rehearse(task(), site, site.measure)
    assert outcome.measured is not None
    assert outcome.asked == site.scanned >= 4
    left = site.lowest_mm - site.inner_mm
    assert LIMIT_MM <= left < LIMIT_MM + 0.6
    assert outcome.raised_mm == pytest.approx(site.lowest_mm - DEPTHS[-1])
    assert outcome.residual_mm == pytest.approx(left, abs=0.2)
    assert not outcome.stopped


def test_what_was_measured_is_held_against_the_way_along_the_axis():
    """Over a leaning boundary a probe measures more than the shortest way: no thicker bone."""
    site, cosine = Plate(MAPPED_MM), 0.9
    planned = task()

    def shortest(places_bed):
        left, drawn = planned.along_axis(places_bed)
        return cosine * left, cosine * drawn

    leaning = rehearse(replace(planned, mapped=shortest), site, site.measure)
    measured = leaning.measured
    assert measured is not None
    assert measured.mapped_mm == pytest.approx(planned.along_axis(measured.places_bed)[0])
    assert leaning.residual_mm == pytest.approx(cosine * (site.lowest_mm - site.inner_mm), abs=0.25)


def test_a_raised_way_is_milled_as_it_was_planned_anew_and_time_goes_on():
    asked, followed, site = [], [], Plate(MAPPED_MM + 0.9)

    def raised(pause, ceiling):
        asked.append((pause, ceiling))
        left = clamped(bed_way())(pause, ceiling)
        postures = np.ones_like(left.qs_rad)
        return replace(left, qs_rad=postures, times_s=10.0 + np.arange(len(left)))

    follow = site.follow
    site.follow = lambda way: (followed.append(way), follow(way))
    outcome = rehearse(task(raised=raised), site, site.measure)
    assert asked == [(outcome.pause, outcome.ceiling_mm)]
    first, rest = followed
    assert (first.layers.max(), rest.layers.min()) == (outcome.pause, outcome.pause + 1)
    assert (first.qs_rad == 0.0).all()
    assert (rest.qs_rad == 1.0).all()
    assert rest.times_s[0] == first.times_s[-1] + 10.0
    assert outcome.steps == len(first) + len(rest)
    assert site.lowest_mm == rest.bottoms_bed[:, 2].min() == outcome.ceiling_mm


def test_without_a_certified_way_milling_ends_with_the_last_finished_layer():
    site = Plate(MAPPED_MM + 0.9)
    outcome = rehearse(task(raised=lambda pause, ceiling: None), site, site.measure)
    assert outcome.ceiling_mm > -np.inf
    assert site.lowest_mm == DEPTHS[outcome.pause]
    assert outcome.steps == (bed_way().layers <= outcome.pause).sum() == len(outcome.through)
    assert outcome.raised_mm == DEPTHS[outcome.pause] - DEPTHS[-1] > 0.0
    assert outcome.residual_mm == pytest.approx(site.lowest_mm - site.inner_mm, abs=0.2)
    assert not outcome.stopped


def test_where_nothing_was_milled_all_of_the_bone_is_left():
    """By the maps there is too little bone to be heard, and no way above it is certified."""
    site = Plate(-3.8)
    outcome = rehearse(task(bed_way((-3.5,)), -3.8, lambda pause, ceiling: None), site, None)
    assert (outcome.pause, outcome.asked, outcome.steps, site.lowest_mm) == (-1, 0, 0, 0.0)
    assert outcome.raised_mm == 3.5
    assert outcome.residual_mm == pytest.approx(3.8, abs=0.1)


def test_bone_as_thick_as_mapped_is_milled_as_planned():
    thick = MAPPED_MM - 0.1
    site = Plate(thick)
    outcome = rehearse(task(mapped_mm=thick), site, site.measure)
    assert site.lowest_mm == DEPTHS[-1]
    assert (outcome.raised_mm, outcome.stopped, outcome.steps) == (0.0, False, len(bed_way()))
    assert outcome.probability > 0.99


def test_the_floor_is_scanned_while_there_is_bone_enough_to_be_heard():
    site = Plate(MAPPED_MM)
    outcome = rehearse(task(), site, site.measure)
    heights = np.unique(site.places[:, 2].round(1))
    assert (heights - MAPPED_MM).min() >= 2.3
    assert outcome.pause < len(DEPTHS) - 1


def test_without_the_scan_the_force_stops_the_burr_and_without_both_nothing_does():
    inner = -2.95  # found in the layer that ends at -3
    deep = task(bed_way((-0.5, -1.0, -1.5, -2.0, -2.5, -3.0, -3.5, -4.0, -4.5, -5.0)), -3.3)
    felt, blind = Plate(inner), Plate(inner)
    stopped = rehearse(deep, felt, felt.measure, Guards(rescan=False))
    assert rehearse(deep, blind, blind.measure, Guards(False, False)).stopped is False
    assert blind.lowest_mm == -5.0
    assert stopped.stopped
    assert felt.lowest_mm > blind.lowest_mm


def test_nothing_is_scanned_where_nobody_asks():
    site = Plate(MAPPED_MM)
    outcome = rehearse(task(), site, site.measure, Guards(rescan=False))
    assert (outcome.asked, outcome.measured, outcome.pause, site.scanned) == (0, None, -1, 0)


def test_a_floor_in_which_nothing_is_heard_leaves_the_maps_to_decide():
    site = Plate(MAPPED_MM + 0.9)

    def deaf(track, places_bed):
        measured, sigma, ok, common = site.measure(track, places_bed)
        return measured, sigma, ~ok, common

    outcome = rehearse(task(), site, deaf)
    assert outcome.asked > 0
    assert outcome.measured is None
    assert outcome.raised_mm >= 0.0


def test_without_a_certified_motion_of_the_probe_the_floor_is_not_scanned():
    site, lines = Plate(MAPPED_MM + 0.9), []
    outcome = rehearse(task(floor_scan=lines.append), site, None)  # nothing to measure with
    assert len(lines) == 1
    assert (site.scanned, outcome.asked, outcome.measured) == (0, 0, None)
    assert outcome.pause >= 0
    # the maps alone decide, and milling goes on
    by_maps = rehearse(task(floor_scan=lambda line: None), Plate(MAPPED_MM), None)
    assert outcome.ceiling_mm == by_maps.ceiling_mm
    assert site.lowest_mm < DEPTHS[outcome.pause]


def test_the_probe_is_there_after_the_burr():
    site = Plate(MAPPED_MM)
    outcome = rehearse(task(), site, site.measure)
    way = bed_way()
    milled_s = way.times_s[way.layers <= outcome.pause].max()
    np.testing.assert_allclose(site.scan_times_s, milled_s + 0.1 * np.arange(site.scanned))


def test_it_can_be_cancelled_and_tells_how_far_it_is():
    site, shares = Plate(MAPPED_MM), []
    with pytest.raises(CancelledError):
        rehearse(task(), site, site.measure, cancel=lambda: True)
    rehearse(task(), site, site.measure, progress=shares.append)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_a_force_that_falls_where_the_maps_know_of_bone_stops_nothing():
    deep = task(bed_way((-0.5, -1.0, -1.5, -2.0, -2.5, -3.0, -3.5)))
    site = Plate(-2.95)  # a hollow, say: the maps have 2 mm of bone below it
    assert not rehearse(deep, site, site.measure, Guards(rescan=False)).stopped
