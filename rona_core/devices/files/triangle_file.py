"""Reader of triangle meshes: STL, PLY, OBJ, in a process of its own."""

import io
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from rona_core.devices.files.reader_process import Found, read_apart
from rona_core.errors import InvalidInputError
from rona_core.geometry.mesh import Mesh

MESH_SUFFIXES = (".stl", ".ply", ".obj")


def read_triangles(source: bytes | Path, name: str) -> Mesh:
    """Return the triangles of a file, corners in the same place made one.

    Args:
        source: Contents of the file, or its path.
        name: Of the file; its extension names the format.

    Raises:
        InvalidInputError: damaged, foreign or empty, or places that are not finite.
    """
    found = read_apart(load_triangles, source, name, Path(name).suffix[1:].upper())
    vertices, faces = np.asarray(found["vertices"]), np.asarray(found["faces"])
    if not len(faces) or not np.isfinite(vertices).all():
        raise InvalidInputError(f"{name} holds no triangles, or vertices that are not finite")
    return Mesh(vertices, faces)


def load_triangles(path: Path, name: str) -> Found:
    """Return vertices (n, 3) and faces (m, 3) of a file of any mesh.

    Raises:
        InvalidInputError: damaged or foreign.
    """
    kind = Path(name).suffix[1:].lower()
    try:  # of bytes, without a folder: files that the mesh names (materials) are not looked for
        data = io.BytesIO(path.read_bytes())
        loaded: Any = trimesh.load(data, file_type=kind, force="mesh")
        loaded.merge_vertices(merge_tex=True, merge_norm=True)
        loaded.update_faces(loaded.nondegenerate_faces())
        loaded.remove_unreferenced_vertices()
        return {
            "vertices": np.array(loaded.vertices, dtype=np.float64),
            "faces": np.array(loaded.faces, dtype=np.int64),
        }
    except MemoryError:
        raise
    except Exception as error:  # the library throws whatever it likes at damaged files
        words = str(error)[:160]
        raise InvalidInputError(
            f"{name} could not be read as {kind.upper()} ({words}): export it again"
        ) from error
