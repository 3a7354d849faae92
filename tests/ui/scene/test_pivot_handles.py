"""The handles about the pointer's tip, on a fake scene."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from rona_core.devices.live import LiveState
from rona_core.devices.trackers import GEOMETRIES
from rona_core.geometry.pose import Pose
from rona_core.session.document import Session
from rona_ui.presentation.snapshot import Snapshot
from rona_ui.presentation.view_state import ViewState
from rona_ui.scene.pointer import PIVOT_HANDLES, PivotHandlesLayer, handle_rotation
from rona_ui.scene.viser_nodes import SceneNodes


class FakeScene:
    """Remembers the transform controls that were added and are still there."""

    def __init__(self) -> None:
        self.there: list[SimpleNamespace] = []

    def add_transform_controls(self, name: str, **options: Any) -> SimpleNamespace:
        node = SimpleNamespace(name=name, **options)
        node.remove = lambda: self.there.remove(node)
        self.there.append(node)
        return node


def test_the_arcs_stay_at_the_tip_as_long_as_somebody_pivots_by_hand() -> None:
    scene, session = FakeScene(), Session()
    layer = PivotHandlesLayer(SceneNodes(scene))
    pose = Pose(np.eye(3), np.array([500.0, -80.0, 300.0]))
    idle = Snapshot(session, ViewState(step="pointer"), (), LiveState())
    layer.render(None, idle)
    layer.render(idle, replace(idle, T_base_pointermarker=pose))  # it pivots by itself
    layer.render(idle, replace(idle, pivoting_by_hand=True))  # not drawn yet
    assert scene.there == []
    pivoting_by_hand = replace(idle, pivoting_by_hand=True, T_base_pointermarker=pose)
    layer.render(idle, pivoting_by_hand)
    (handles,) = scene.there
    assert (handles.name, handles.disable_axes, handles.disable_sliders) == (
        PIVOT_HANDLES,
        True,
        True,
    )
    tip_base = pose @ GEOMETRIES[session.setup.devices.pointer].nominal_tip_marker
    np.testing.assert_allclose(handles.position, tip_base / 1000.0, atol=1e-6)
    moved = Pose(np.diag([1.0, -1.0, -1.0]), np.array([510.0, -70.0, 290.0]))
    elsewhere = replace(idle.view, step="scan")
    layer.render(
        pivoting_by_hand, replace(pivoting_by_hand, T_base_pointermarker=moved, view=elsewhere)
    )
    assert scene.there == [handles]
    np.testing.assert_allclose(handles.position, tip_base / 1000.0, atol=1e-6)
    np.testing.assert_allclose(handle_rotation(handles.wxyz), (1.0, 0.0, 0.0, 0.0), atol=1e-12)
    layer.render(pivoting_by_hand, idle)
    assert scene.there == []


def test_a_turn_is_told_along_the_axes_of_the_base() -> None:
    scene, session = FakeScene(), Session()
    pose = Pose(np.eye(3), np.zeros(3))
    shown = Snapshot(
        session, ViewState(), (), LiveState(), T_base_pointermarker=pose, pivoting_by_hand=True
    )
    PivotHandlesLayer(SceneNodes(scene)).render(None, shown)
    start = Pose.from_wxyz(scene.there[0].wxyz)
    for axis in np.eye(3):
        turn_base = Pose.from_rotvec(0.4 * axis)
        np.testing.assert_allclose(
            handle_rotation((turn_base @ start).wxyz()), turn_base.wxyz(), atol=1e-12
        )
