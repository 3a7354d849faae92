"""Step 10 in the scene: implant, bed and path where they are, probabilities on the bone."""

from dataclasses import replace

import numpy as np
import pytest

from rona_core.app.steps.implant.view import milling_view, outline_base
from rona_core.planning.implants.implant import implant_named
from rona_core.planning.milling.milling_path import Move
from rona_core.session.document import Session
from rona_ui.presentation.colors import MILLING_COLORS, viridis
from rona_ui.presentation.view_state import LAYERS, ViewState
from rona_ui.scene.cut_plane import cut_plane
from rona_ui.scene.implant import (
    ASTRAY,
    CELLS,
    EXPECTED,
    EXPECTED_MM,
    IMPLANT,
    IMPLANT_CUT,
    POCKET,
    RING,
    SAFE,
    SCREWS,
    THINNEST,
    THINNEST_LABEL,
    BedLayer,
    ChanceLayer,
    ExpectedOutlineLayer,
    ImplantLayer,
    MillingLayer,
    UnmappedLayer,
    bone_words,
    pocket_base,
)
from tests.helpers.ui.beds import laid_astray
from tests.ui.panels.test_obstacles_panel import ROOM
from tests.ui.panels.test_panels import snapshot

STEP = ViewState(step="implant", hidden=frozenset())


class Nodes:
    """Remembers what is drawn by its name, and whether it is to be seen."""

    def __init__(self):
        self.drawn, self.seen = {}, {}

    def mesh(self, node, mesh, color, **look):
        self.drawn[node] = mesh

    def cloud(self, node, points, colors, *, size_mm):
        self._put(node, points, colors)

    def dots(self, node, points, colors, *, size_px):
        self._put(node, points, colors)

    def lines(self, node, pairs, color, **look):
        self._put(node, pairs, color)

    def label(self, node, text, place):
        self.drawn[node] = text

    def _put(self, node, places, look):
        if len(places):
            self.drawn[node] = places, look
        else:
            self.remove(node)

    def show(self, node, visible):
        self.seen[node] = visible

    def remove(self, node):
        self.drawn.pop(node, None)


@pytest.fixture(scope="module")
def astray(demo):
    return laid_astray(demo)


@pytest.fixture(scope="module")
def milling(demo):
    return milling_view(demo)


def looked_at(session, milling=None, view=STEP, room=ROOM):
    return snapshot(session, view=view, milling=milling, static_scene=room)


def drawn(kind, *snapshots):
    nodes, old = Nodes(), None
    layer = kind(nodes)
    for new in snapshots:
        layer.render(old, new)
        old = new
    return nodes


def test_the_implant_stands_out_of_its_seat_by_its_lift(demo, milling):
    nodes = drawn(ImplantLayer, looked_at(demo, milling))
    bed = demo.results.get("bed").value
    T_bed_base = bed.placed.T_base_bed.inv()
    height = (T_bed_base @ nodes.drawn[IMPLANT].vertices)[:, 2]
    deepest = milling.implant.terraces()[-1].depth_mm
    assert (height.max(), height.min()) == pytest.approx((bed.lift_mm, -deepest), abs=1e-6)
    ends = T_bed_base @ nodes.drawn[SCREWS][0].reshape(-1, 3)
    for screw, pair in zip(milling.implant.screws, ends.reshape(-1, 2, 3), strict=True):
        np.testing.assert_allclose(pair[:, 0], screw.x_mm, atol=1e-9)
        assert pair[0, 2] - pair[1, 2] == pytest.approx(screw.length_mm)


def test_the_pocket_is_open_above_and_as_deep_as_the_bed(milling):
    pocket = pocket_base(milling)
    corners = milling.placed.T_base_bed.inv() @ pocket.vertices
    flat = (np.abs(corners[:, 2]) < 1e-9)[pocket.faces].all(axis=1)
    assert not flat.any()
    assert -corners[:, 2].min() == pytest.approx(milling.bed.depth_mm.max(), abs=0.02)


def test_the_least_bone_is_marked_and_told(demo, milling):
    nodes = drawn(BedLayer, looked_at(demo, milling))
    np.testing.assert_allclose(nodes.drawn[THINNEST][0][0], milling.placed.thinnest_base)
    assert nodes.drawn[THINNEST_LABEL] == f"{milling.placed.residual_mm:.2f} mm of bone"
    assert POCKET in nodes.drawn
    assert (bone_words(0.5), bone_words(-1.239)) == ("0.50 mm of bone", "1.24 mm through the bone")


def test_every_move_is_drawn_once_in_the_colour_of_its_kind(demo, milling):
    nodes = drawn(MillingLayer, looked_at(demo, milling))
    assert {kind.upper() for kind in MILLING_COLORS} == {move.name for move in Move}
    counts = [len(pairs) for pairs, _ in nodes.drawn.values()]
    assert sum(counts) == len(milling.path) - 1
    for kind, (_, color) in MILLING_COLORS.items():
        pairs, used = nodes.drawn[f"/milling/{kind}"]
        assert len(pairs) == np.count_nonzero(milling.path.moves[1:] == Move[kind.upper()])
        assert used == color


def test_a_cut_goes_through_the_implant_and_shows_its_outline(demo, milling):
    placed = milling.placed.T_base_bed
    room = replace(
        ROOM, region_center_base=placed.translation, region_normal_base=placed.rotation[:, 2]
    )
    view = replace(STEP, cut_direction="lengthwise")
    whole, half = (looked_at(demo, milling, v, room) for v in (STEP, view))
    nodes = drawn(ImplantLayer, whole)
    complete = np.ptp(nodes.drawn[IMPLANT].vertices @ cut_plane(half).normal_base)
    assert IMPLANT_CUT not in nodes.drawn
    nodes = drawn(ImplantLayer, whole, half)
    left = np.ptp(nodes.drawn[IMPLANT].vertices @ cut_plane(half).normal_base)
    assert left == pytest.approx(0.5 * complete, rel=0.02)
    outline = nodes.drawn[IMPLANT_CUT][0].reshape(-1, 3)
    off = (outline - placed.translation) @ placed.rotation[:, 2]
    assert np.ptp(off) == pytest.approx(
        milling.implant.terraces()[-1].depth_mm + milling.implant.lift_mm, abs=1e-6
    )


def test_probabilities_lie_on_the_outer_boundary_and_white_dots_where_it_is_safe(
    demo,
    milling,
):
    nodes = drawn(ChanceLayer, looked_at(demo, milling))
    bed, outer = demo.results.get("bed").value, demo.results.maps.value.outer
    points, colors = nodes.drawn[CELLS]
    mapped = (bed.lacks != 1) & outer.ok
    assert len(points) == np.count_nonzero(mapped)
    np.testing.assert_array_equal(colors, viridis(bed.probability[mapped]))
    cells = outer.T_base_map.inv() @ (points - (0.0, 0.0, 1.5))
    np.testing.assert_allclose(cells[:, 2], outer.height_mm[mapped], atol=1e-9)
    assert len(nodes.drawn[SAFE][0]) == np.count_nonzero(bed.lacks == 0)
    ring = nodes.drawn[RING][0].reshape(-1, 3).mean(axis=0)
    assert np.linalg.norm(ring - milling.placed.T_base_bed.translation) < 5.0


def test_outside_of_the_maps_only_the_outline_is_left(demo, astray, milling):
    fits, lost = looked_at(demo, milling), looked_at(astray)
    for kind in (ImplantLayer, BedLayer, MillingLayer):
        assert drawn(kind, fits, lost).drawn == {}
    assert drawn(UnmappedLayer, fits).drawn == {}
    assert set(drawn(UnmappedLayer, fits, lost).drawn) == {ASTRAY}
    assert set(drawn(ChanceLayer, fits, lost).drawn) == {RING}


def test_without_a_bed_nothing_is_drawn(demo, milling):
    for kind in (ImplantLayer, BedLayer, MillingLayer, UnmappedLayer, ChanceLayer):
        assert drawn(kind, looked_at(demo, milling), looked_at(Session())).drawn == {}


def test_a_layer_is_seen_in_its_step_where_it_is_switched_on(demo, milling):
    assert {"implant", "bed", "milling", "chance"} <= LAYERS.keys()
    usual = ViewState(step="implant")
    assert all(drawn(ImplantLayer, looked_at(demo, milling, usual)).seen.values())
    assert not any(drawn(MillingLayer, looked_at(demo, milling, usual)).seen.values())
    elsewhere = replace(STEP, step="maps")
    assert not any(drawn(ImplantLayer, looked_at(demo, milling, elsewhere)).seen.values())


@pytest.mark.parametrize("drawing", [None, "path"])
def test_the_outline_of_the_implant_stands_on_the_bone_while_a_path_is_drawn(demo, drawing):
    nodes = Nodes()
    before = demo.with_result("bed", None)
    view = ViewState(step="path", drawing=drawing)
    ExpectedOutlineLayer(nodes).render(None, snapshot(before, view=view))
    assert nodes.seen[EXPECTED]
    points = nodes.drawn[EXPECTED][0].reshape(-1, 3)
    cloud = demo.results.surface.value.points_base
    middle = np.median(cloud, axis=0)
    rings = np.concatenate(implant_named("BCI 602").outline())
    off_mm = np.linalg.norm(points - middle, axis=1)
    assert off_mm.max() == pytest.approx(np.hypot(np.hypot(*rings.T).max(), EXPECTED_MM), abs=0.1)
    ExpectedOutlineLayer(nodes).render(None, snapshot(before, view=ViewState(step="setup")))
    assert not nodes.seen[EXPECTED]


def test_the_outline_lies_where_the_bed_does_and_nowhere_before_the_surface(demo):
    nodes = Nodes()
    ExpectedOutlineLayer(nodes).render(None, snapshot(demo, view=ViewState(step="path")))
    rings = np.concatenate(outline_base(demo.results.get("bed").value, EXPECTED_MM))
    found = nodes.drawn[EXPECTED][0].reshape(-1, 3)
    assert np.linalg.norm(found.mean(axis=0) - rings.mean(axis=0)) < 0.5
    ExpectedOutlineLayer(nodes).render(None, snapshot(Session(), view=ViewState(step="path")))
    assert EXPECTED not in nodes.drawn
