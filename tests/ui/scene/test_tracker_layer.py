"""The drawn volume of the tracker is the one it measures in."""

from dataclasses import replace

import numpy as np
import pytest

from rona_core.app.dependencies.judge import step_states
from rona_core.devices.live import LiveState
from rona_core.devices.settings import TrackerSettings
from rona_core.devices.trackers import SILO, VOLUMES
from rona_core.geometry.mesh import Mesh
from rona_core.geometry.pose import Pose
from rona_core.session.document import Session
from rona_ui.presentation.snapshot import Snapshot
from rona_ui.presentation.static_scene import StaticScene
from rona_ui.presentation.view_state import ViewState
from rona_ui.scene.setup.tracker import VOLUME, TrackerLayer, outline

T_BASE_TRACKER = Pose.from_rotvec((0.4, -2.0, 0.3), (1500.0, 300.0, 900.0))


class SceneNodes:
    """Remembers the lines that were drawn."""

    def __init__(self) -> None:
        self.drawn: list[np.ndarray] = []

    def lines(self, node, segments, color, width_px):
        assert node == VOLUME
        self.drawn.append(segments)

    def mesh(self, *args):
        pass

    label = show = mesh


def snapshot(static_scene, profile):
    session = Session()
    devices = replace(session.setup.devices, tracker=TrackerSettings(profile=profile))
    held = replace(session, setup=replace(session.setup, devices=devices))
    return Snapshot(held, ViewState(), step_states(held), LiveState(), static_scene=static_scene)


@pytest.mark.parametrize("profile", VOLUMES)
def test_all_lines_lie_on_the_border_of_the_volume(profile):
    volume = VOLUMES[profile]
    lines = outline(volume, T_BASE_TRACKER)
    points = T_BASE_TRACKER.inv() @ lines.reshape(-1, 3)
    inward = points * (0.999, 0.999, 1.0)
    inward[:, 2] = np.clip(inward[:, 2], volume.near_mm + 1e-6, volume.far_mm - 1e-6)
    if volume is SILO:  # its near end is a dome: the ring stands where it begins in the middle
        inward = inward[np.linalg.norm(inward, axis=1) >= volume.near_mm]
    assert volume.contains(inward).all()
    outward = points * (1.001, 1.001, 1.0)
    corners = np.abs(points[:, :2]).max(axis=1) > 0
    assert not volume.contains(outward[corners]).any()


def test_another_profile_draws_another_volume_and_the_same_one_draws_nothing():
    empty = Mesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64))
    static_scene = StaticScene(
        "VIRTUAL", empty, np.zeros(3), np.array((0, 0, 1.0)), 25.0, T_BASE_TRACKER, np.zeros(6)
    )
    nodes = SceneNodes()
    layer = TrackerLayer(nodes, -420.0)
    first, second = snapshot(static_scene, "polaris"), snapshot(static_scene, "vega")
    layer.render(None, first)
    layer.render(first, first)
    assert len(nodes.drawn) == 1
    layer.render(first, second)
    assert len(nodes.drawn) == 2
    np.testing.assert_allclose(nodes.drawn[1], outline(VOLUMES["vega"], T_BASE_TRACKER))
