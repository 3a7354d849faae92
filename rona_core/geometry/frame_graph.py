"""Frame graph: poses between named frames, with source and covariance.

The graph is a tree. A pose between any two of its frames is the chain of edges between them, its
covariance follows to first order from those of the edges, correlated ones taken together. Every
covariance is that of the deviation in ``geometry/pose_covariance.py``.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rona_core.errors import InvalidInputError, NotFoundError
from rona_core.geometry.arrays import Floats, readonly
from rona_core.geometry.pose import Pose
from rona_core.geometry.pose_covariance import as_covariance, point_jacobians


@dataclass(frozen=True, slots=True, eq=False)
class FrameEdge:
    """The pose of frame ``right`` in frame ``left``."""

    left: str
    right: str
    T_a_b: Pose  # a is left, b is right
    source: str  # what it was measured or computed by
    covariance: Floats | None = None  # (6, 6); None: exact, or part of a joint covariance

    @property
    def name(self) -> str:
        """Name of the transform, ``T_left_right``."""
        return f"T_{self.left}_{self.right}"


@dataclass(frozen=True, slots=True, eq=False)
class JointCovariance:
    """Covariance of several edges whose errors belong together: (6 k, 6 k) in their order."""

    names: tuple[str, ...]
    covariance: Floats


@dataclass(frozen=True, slots=True, eq=False)
class FrameGraph:
    """A tree of frames."""

    edges: tuple[FrameEdge, ...]
    joint: tuple[JointCovariance, ...] = ()

    def __post_init__(self) -> None:
        """Check that there is one way between any two frames, and one covariance an edge.

        Raises:
            InvalidInputError: two ways between frames, or covariances that do not fit the edges.
        """
        root: dict[str, str] = {}

        def find(frame: str) -> str:
            while root.setdefault(frame, frame) != frame:
                frame = root[frame]
            return frame

        for edge in self.edges:
            a, b = find(edge.left), find(edge.right)
            if a == b:
                raise InvalidInputError(f"{edge.name} is a second way between its frames")
            root[a] = b
            if edge.covariance is not None:
                as_covariance(edge.covariance, 6, name=f"covariance of {edge.name}")
        free = {edge.name for edge in self.edges if edge.covariance is None}
        for block in self.joint:
            as_covariance(block.covariance, 6 * len(block.names), name="joint covariance")
            for name in block.names:
                if name not in free:
                    raise InvalidInputError(
                        f"{name} has a covariance already, occurs twice, or is not in the graph"
                    )
                free.remove(name)

    def chain(self, left: str, right: str) -> tuple[tuple[FrameEdge, bool], ...]:
        """Return the edges from ``left`` to ``right``, each with whether it points forward.

        Raises:
            NotFoundError: no such frame, or the two are not connected.
        """
        frames = {frame for edge in self.edges for frame in (edge.left, edge.right)}
        for frame in (left, right):
            if frame not in frames:
                raise NotFoundError(f"there is no frame {frame!r} in the graph")
        chains: dict[str, tuple[tuple[FrameEdge, bool], ...]] = {left: ()}
        queue = [left]
        for frame in queue:
            for edge in self.edges:
                for start, end, forward in (
                    (edge.left, edge.right, True),
                    (edge.right, edge.left, False),
                ):
                    if start == frame and end not in chains:
                        chains[end] = (*chains[frame], (edge, forward))
                        queue.append(end)
        if right not in chains:
            raise NotFoundError(f"frames {left!r} and {right!r} are not connected")
        return chains[right]

    def pose(self, left: str, right: str) -> Pose:
        """Return the pose of frame ``right`` in frame ``left``."""
        T_a_b = Pose.identity()
        for edge, along in self.chain(left, right):
            T_a_b = T_a_b @ (edge.T_a_b if along else edge.T_a_b.inv())
        return T_a_b

    def covariance(self, left: str, right: str) -> Floats:
        """Return the covariance (6, 6) of the pose of ``right`` in ``left``."""
        blocks = self._jacobians(left, right)
        total = np.zeros((6, 6))
        for edge, _ in self.chain(left, right):
            if edge.covariance is not None:
                total += blocks[edge.name] @ edge.covariance @ blocks[edge.name].T
        for joint in self.joint:
            whole = np.hstack([blocks.get(name, np.zeros((6, 6))) for name in joint.names])
            total += whole @ joint.covariance @ whole.T
        return readonly((total + total.T) / 2.0)

    def _jacobians(self, left: str, right: str) -> dict[str, Floats]:
        """Return by edge how the deviation of the whole pose depends on that of the edge."""
        chain = self.chain(left, right)
        rotation = np.eye(3)  # from the frame before the edge into left
        found: dict[str, Floats] = {}
        for i, (edge, along) in enumerate(chain):
            origin = _origin(chain[i + 1 :])  # of right, in the frame behind the edge
            if along:
                rotating = rotation
                shifting = point_jacobians(edge.T_a_b, origin[None])[0]
                behind = edge.T_a_b.rotation
            else:
                rotating = -rotation @ edge.T_a_b.rotation.T
                shifting = point_jacobians(edge.T_a_b, origin[None], direction="backward")[0]
                behind = edge.T_a_b.rotation.T
            J = np.zeros((6, 6))
            J[:3, :3] = rotating
            J[3:] = rotation @ shifting
            found[edge.name] = J
            rotation = rotation @ behind
        return found


def _origin(rest: Sequence[tuple[FrameEdge, bool]]) -> Floats:
    """Return where the last frame of a chain has its origin, in the first one."""
    point = np.zeros(3)
    for edge, along in reversed(rest):
        point = (edge.T_a_b if along else edge.T_a_b.inv()) @ point
    return point
