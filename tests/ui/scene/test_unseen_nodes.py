"""Nodes of the scene that nobody sees are not sent before somebody does, and then as they are."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rona_core.geometry.pose import Pose
from rona_ui.scene.line_colors import sent_color
from rona_ui.scene.viser_nodes import SceneNodes

PAIRS = np.array([[[0.0, 0.0, 0.0], [1000.0, 0.0, 0.0]]])


class FakeScene:
    """Keeps what was sent by name."""

    def __init__(self) -> None:
        self.sent: dict[str, SimpleNamespace] = {}

    def __getattr__(self, kind: str) -> Any:
        def add(name: str, **options: Any) -> SimpleNamespace:
            node = SimpleNamespace(kind=kind, visible=True, **options)
            node.remove = lambda: self.sent.pop(name)
            self.sent[name] = node
            return node

        return add


@pytest.fixture
def scene() -> FakeScene:
    return FakeScene()


@pytest.fixture
def nodes(scene: FakeScene) -> SceneNodes:
    return SceneNodes(scene)


def test_what_is_hidden_is_sent_when_it_is_shown_as_it_is_then(
    scene: FakeScene, nodes: SceneNodes
) -> None:
    with nodes.sent_when_seen():
        nodes.lines("/hidden", PAIRS, (1, 2, 3))
        nodes.lines("/seen", PAIRS, (1, 2, 3))
        nodes.show("/hidden", False)
        assert scene.sent == {}
    assert set(scene.sent) == {"/seen"}
    assert nodes.names() == {"/hidden", "/seen"}
    assert nodes.node("/hidden") is None
    with nodes.sent_when_seen():
        nodes.lines("/hidden", 2.0 * PAIRS, (4, 5, 6))
    assert set(scene.sent) == {"/seen"}
    with nodes.sent_when_seen():
        nodes.show("/hidden", True)
    node = scene.sent["/hidden"]
    np.testing.assert_allclose(node.points, 0.002 * PAIRS)
    np.testing.assert_array_equal(node.colors, sent_color((4, 5, 6)))
    assert nodes.node("/hidden") is node
    with nodes.sent_when_seen():
        nodes.show("/hidden", False)
    assert scene.sent["/hidden"] is node  # once there it stays
    assert not node.visible


def test_children_wait_for_a_hidden_parent(scene: FakeScene, nodes: SceneNodes) -> None:
    with nodes.sent_when_seen():
        nodes.frame("/robot/link0", Pose(np.eye(3), np.zeros(3)))
        nodes.lines("/robot/link0/part", PAIRS, (1, 2, 3))
        nodes.show("/robot/link0", False)
    assert scene.sent == {}
    with nodes.sent_when_seen():
        nodes.frame("/robot/link0", Pose(np.eye(3), np.array([0.0, 0.0, 500.0])))
        nodes.show("/robot/link0", True)
    assert list(scene.sent) == ["/robot/link0", "/robot/link0/part"]
    np.testing.assert_allclose(scene.sent["/robot/link0"].position, (0.0, 0.0, 0.5))


def test_what_is_removed_before_it_was_seen_is_never_sent(
    scene: FakeScene, nodes: SceneNodes
) -> None:
    with nodes.sent_when_seen():
        nodes.lines("/gone", PAIRS, (1, 2, 3))
        nodes.show("/gone", False)
    nodes.remove("/gone")
    with nodes.sent_when_seen():
        nodes.show("/gone", True)
    assert scene.sent == {}
    assert nodes.names() == frozenset()
