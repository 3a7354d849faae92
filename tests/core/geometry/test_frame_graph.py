import numpy as np
import pytest
from hypothesis import given, settings

from rona_core.errors import InvalidInputError, NotFoundError
from rona_core.geometry.frame_graph import FrameEdge, FrameGraph, JointCovariance
from rona_core.geometry.pose import Pose
from rona_core.geometry.pose_covariance import deviate, deviation_between
from tests.helpers.strategies import disturbed, random_pose, seeds

few = settings(max_examples=20, deadline=None)
SCALES = np.repeat((1e-3, 0.2), 3)


def covariance(rng, k=1):
    root = rng.normal(size=(6 * k, 6 * k)) * np.tile(SCALES, k)[:, None]
    return root @ root.T


def graph(rng):
    """base - tracker - pointermarker - pointertip, tracker - toolmarker - tip, tip the odd way."""
    edges = (
        FrameEdge("base", "tracker", random_pose(rng), "tool"),
        FrameEdge("tracker", "pointermarker", random_pose(rng), "frame", covariance(rng)),
        FrameEdge("pointermarker", "pointertip", random_pose(rng, 200), "pointer", covariance(rng)),
        FrameEdge("tip", "toolmarker", random_pose(rng, 200), "tool"),
        FrameEdge("tracker", "toolmarker", random_pose(rng), "frame"),
    )
    joint = JointCovariance(("T_base_tracker", "T_tip_toolmarker"), covariance(rng, 2))
    return FrameGraph(edges, (joint,))


@given(seed=seeds)
@few
def test_poses_are_the_chain_of_edges_either_way(seed):
    frames = graph(np.random.default_rng(seed))
    edges = {edge.name: edge.T_a_b for edge in frames.edges}
    expected = (
        edges["T_tip_toolmarker"]
        @ edges["T_tracker_toolmarker"].inv()
        @ edges["T_tracker_pointermarker"]
        @ edges["T_pointermarker_pointertip"]
    )
    found = frames.pose("tip", "pointertip")
    np.testing.assert_allclose(found.matrix(), expected.matrix(), atol=1e-9)
    back = frames.pose("pointertip", "tip")
    np.testing.assert_allclose((found @ back).matrix(), np.eye(4), atol=1e-9)
    assert frames.pose("base", "base").matrix().tolist() == np.eye(4).tolist()


@given(seed=seeds)
@few
def test_the_covariance_is_that_of_finite_differences(seed):
    rng = np.random.default_rng(seed)
    frames = graph(rng)
    names = [edge.name for edge in frames.edges]
    whole = np.zeros((30, 30))
    for i, edge in enumerate(frames.edges):
        if edge.covariance is not None:
            whole[6 * i : 6 * i + 6, 6 * i : 6 * i + 6] = edge.covariance
    rows = np.concatenate([6 * names.index(n) + np.arange(6) for n in frames.joint[0].names])
    whole[np.ix_(rows, rows)] = frames.joint[0].covariance
    for left, right in (("base", "pointertip"), ("tip", "base"), ("pointertip", "tip")):
        pose = frames.pose(left, right)
        J = np.zeros((6, 30))
        for k in range(30):
            step = np.zeros(6)
            step[k % 6] = 1e-6
            edges = list(frames.edges)
            edge = edges[k // 6]
            edges[k // 6] = FrameEdge(edge.left, edge.right, deviate(edge.T_a_b, step), edge.source)
            J[:, k] = deviation_between(pose, FrameGraph(tuple(edges)).pose(left, right)) / 1e-6
        expected = J @ whole @ J.T
        size = np.sqrt(np.diag(expected))
        np.testing.assert_allclose(
            frames.covariance(left, right) / np.outer(size, size),
            expected / np.outer(size, size),
            atol=1e-4,
        )


def test_errors_that_cancel_are_seen_to_cancel():
    """A tip too far along is a tracker too far back: from tip to tracker they must not add."""
    eye = Pose.identity()
    shift = np.zeros((6, 6))
    shift[5, 5] = 1.0
    both = np.block([[shift, -shift], [-shift, shift]])
    edges = (FrameEdge("base", "tracker", eye, "a"), FrameEdge("tracker", "tip", eye, "b"))
    names = ("T_base_tracker", "T_tracker_tip")
    joint = FrameGraph(edges, (JointCovariance(names, both),))
    apart = FrameGraph(edges, tuple(JointCovariance((name,), shift) for name in names))
    assert joint.covariance("base", "tip")[5, 5] == pytest.approx(0.0, abs=1e-12)
    assert apart.covariance("base", "tip")[5, 5] == pytest.approx(2.0)


@pytest.mark.slow
def test_disturbed_graphs_scatter_as_told():
    rng = np.random.default_rng(1)
    frames = graph(rng)
    small = FrameGraph(
        tuple(
            FrameEdge(e.left, e.right, e.T_a_b, e.source, None if c is None else c * 1e-2)
            for e in frames.edges
            for c in (e.covariance,)
        ),
        tuple(JointCovariance(j.names, j.covariance * 1e-2) for j in frames.joint),
    )
    pose = small.pose("base", "pointertip")
    offs = np.array(
        [
            deviation_between(pose, disturbed(small, rng).pose("base", "pointertip"))
            for _ in range(3000)
        ]
    )
    expected = small.covariance("base", "pointertip")
    size = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(
        np.cov(offs.T) / np.outer(size, size), expected / np.outer(size, size), atol=0.09
    )


def test_graphs_that_are_no_trees_are_refused():
    eye = Pose.identity()
    one, two = FrameEdge("base", "tracker", eye, "a"), FrameEdge("tracker", "base", eye, "b")
    with pytest.raises(InvalidInputError, match="second way"):
        FrameGraph((one, two))
    with pytest.raises(NotFoundError, match="no frame 'skull'"):
        FrameGraph((one,)).pose("base", "skull")
    apart = FrameGraph((one, FrameEdge("skull", "mesh", eye, "c")))
    with pytest.raises(NotFoundError, match="not connected"):
        apart.pose("base", "mesh")
    with pytest.raises(InvalidInputError, match="has a covariance already"):
        FrameGraph(
            (FrameEdge("base", "tracker", eye, "a", np.eye(6)),),
            (JointCovariance(("T_base_tracker",), np.eye(6)),),
        )
    with pytest.raises(InvalidInputError, match="not symmetric"):
        FrameGraph((FrameEdge("base", "tracker", eye, "a", np.triu(np.ones((6, 6)))),))
    with pytest.raises(InvalidInputError, match=r"\(12, 12\)"):
        FrameGraph((one,), (JointCovariance(("T_base_tracker", "T_a_b"), np.eye(6)),))
