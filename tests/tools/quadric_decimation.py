"""Decimation of a triangle mesh by quadric edge collapses (Garland 1997)."""

import heapq

import numpy as np

BORDER, STAY, SHORT = 10.0, 1e-3, 1e-3  # weights: open borders, middle of the edge, short edges
TURN = 0.2  # cosine: no triangle may turn by more


def decimate(
    vertices: np.ndarray, faces: np.ndarray, count: int, weights: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return a mesh of about ``count`` faces; what has more weight (n,) keeps more of them."""
    mesh = _Collapsing(vertices, faces, weights)
    while mesh.left > count and mesh.heap:
        mesh.step()
    kept = np.array([face for face, alive in zip(mesh.faces, mesh.alive, strict=True) if alive])
    numbers, renumbered = np.unique(kept, return_inverse=True)
    return mesh.v[numbers], renumbered.reshape(-1, 3)


def _quadrics(v: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the squared distance from the planes round each vertex, as (n, 4, 4)."""
    corners = v[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    normals = normals / np.maximum(areas, 1e-12)[:, None]
    planes = np.column_stack((normals, -np.einsum("ij,ij->i", normals, corners[:, 0])))
    squares = planes[:, :, None] * planes[:, None, :] * (0.5 * areas)[:, None, None]
    q = np.zeros((len(v), 4, 4))
    for k in range(3):
        np.add.at(q, faces[:, k], squares)
    pairs = np.sort(np.concatenate((faces[:, (0, 1)], faces[:, (1, 2)], faces[:, (2, 0)])), axis=1)
    _, first, uses = np.unique(pairs, axis=0, return_index=True, return_counts=True)
    for i in first[uses == 1]:  # a plane upright on each open edge
        a, b = pairs[i]
        edge = v[b] - v[a]
        upright = np.cross(edge, normals[i % len(faces)])
        length = np.linalg.norm(upright)
        if length > 1e-9:
            plane = np.append(upright, -upright @ v[a]) / length
            q[[a, b]] += np.outer(plane, plane) * (edge @ edge) * BORDER
    return q


class _Collapsing:
    """A mesh whose cheapest edge is collapsed, one after the other."""

    def __init__(self, vertices: np.ndarray, faces: np.ndarray, weights: np.ndarray) -> None:
        self.v = vertices.copy()
        self.q = _quadrics(vertices, faces) * weights[:, None, None]
        self.faces = [tuple(face) for face in faces.tolist()]
        self.alive = [True] * len(self.faces)
        self.left = len(self.faces)
        self.heap: list[tuple] = []
        self._of: list[set[int]] = [set() for _ in vertices]
        for i, face in enumerate(self.faces):
            for k in face:
                self._of[k].add(i)
        self._stamps, self._gone = [0] * len(vertices), [False] * len(vertices)
        edges = np.concatenate((faces[:, (0, 1)], faces[:, (1, 2)], faces[:, (2, 0)]))
        for a, b in np.unique(np.sort(edges, axis=1), axis=0).tolist():
            self._push(a, b)

    def _push(self, a: int, b: int) -> None:
        q = self.q[a] + self.q[b]
        stay = STAY * np.trace(q[:3, :3])
        edge, middle = self.v[a] - self.v[b], 0.5 * (self.v[a] + self.v[b])
        place = np.linalg.solve(q[:3, :3] + stay * np.eye(3), stay * middle - q[:3, 3])
        h = np.append(place, 1.0)
        cost = float(h @ q @ h) + SHORT * float(edge @ edge)
        heapq.heappush(self.heap, (cost, a, b, self._stamps[a], self._stamps[b], tuple(place)))

    def step(self) -> None:
        """Collapse the cheapest edge, unless it is out of date or would fold the mesh."""
        _, a, b, stamp_a, stamp_b, at = heapq.heappop(self.heap)
        if self._gone[a] or self._gone[b]:
            return
        if (self._stamps[a], self._stamps[b]) != (stamp_a, stamp_b):
            return
        shared, place = self._of[a] & self._of[b], np.array(at)
        if len(self._round(a, b) & self._round(b, a)) != len(shared):
            return
        if any(self._turns(i, k, place) for k in (a, b) for i in self._of[k] - shared):
            return
        self._collapse(a, b, place, shared)

    def _round(self, a: int, b: int) -> set[int]:
        return {k for i in self._of[a] for k in self.faces[i]} - {a, b}

    def _turns(self, face: int, moved: int, place: np.ndarray) -> bool:
        p = [self.v[k] for k in self.faces[face]]
        r = [place if k == moved else self.v[k] for k in self.faces[face]]
        n, m = np.cross(p[1] - p[0], p[2] - p[0]), np.cross(r[1] - r[0], r[2] - r[0])
        return bool(n @ m <= TURN * np.sqrt((n @ n) * (m @ m)))

    def _collapse(self, a: int, b: int, place: np.ndarray, shared: set[int]) -> None:
        self.v[a] = place
        self.q[a] = self.q[a] + self.q[b]
        self._gone[b] = True
        for i in shared:
            self.alive[i] = False
            self.left -= 1
            for k in self.faces[i]:
                self._of[k].discard(i)
        for i in list(self._of[b]):
            self.faces[i] = tuple(a if k == b else k for k in self.faces[i])
            self._of[a].add(i)
        self._of[b] = set()
        self._stamps[a] += 1
        for k in {k for i in self._of[a] for k in self.faces[i]} - {a}:
            self._push(min(a, k), max(a, k))
