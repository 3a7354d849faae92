"""Read a chain of six turning joints from a URDF file: offsets, axes, limits and speeds."""

import importlib.metadata
import importlib.util
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats, readonly

PACKAGE = "example-robot-data"
FOLDER = Path("share") / PACKAGE / "robots"
MM_PER_M = 1000.0


@dataclass(frozen=True, slots=True, eq=False)
class UrdfChain:
    """Joints from base to flange as the file states them, lengths in mm."""

    offsets_mm: Floats  # (7, 3) of each joint, and of the flange, in the frame before it
    rotations: Floats  # (7, 3, 3) likewise, at zero
    axes: Floats  # (6, 3) of each joint, in its own frame
    lower_rad: Floats  # (6,)
    upper_rad: Floats  # (6,)
    speed_rad_per_s: Floats  # (6,)


def description_path(relative: str) -> Path:
    """Return a file of the package example-robot-data, wherever it is installed.

    Raises:
        InvalidInputError: the package or the file is not there.
    """
    for root in _roots():
        path = root / FOLDER / relative
        if path.is_file():
            return path
    raise InvalidInputError(
        f"{FOLDER / relative} is not installed: this robot needs the package {PACKAGE} "
        f"(pip install {PACKAGE})"
    )


def _roots() -> list[Path]:
    """Return the folders whose ``share`` may hold the descriptions."""
    roots: list[Path] = []
    for module in ("cmeel", "pinocchio", "coal"):  # they share one prefix in site-packages
        spec = importlib.util.find_spec(module)
        if spec is not None and spec.origin is not None:
            origin = Path(spec.origin)
            roots += [folder / "cmeel.prefix" for folder in origin.parents[1:3]]
            roots += list(origin.parents[2:5])  # a prefix of its own, as conda's
    try:
        roots.append(Path(str(importlib.metadata.distribution(PACKAGE).locate_file(""))))
        roots.append(roots[-1] / "cmeel.prefix")
    except importlib.metadata.PackageNotFoundError:
        pass
    return roots


def read_chain(path: str | Path, base: str, flange: str) -> UrdfChain:
    """Return the chain between two links of a URDF file.

    Raises:
        InvalidInputError: no such file, no such chain, or not six turning joints with limits.
    """
    try:
        root = ElementTree.parse(path).getroot()
    except (OSError, ElementTree.ParseError) as error:
        raise InvalidInputError(f"{path} cannot be read as URDF: {error}") from error
    joints: list[ElementTree.Element] = []
    link = flange
    above = {_link(joint, "child"): joint for joint in root.findall("joint")}
    while link != base:
        if link not in above or len(joints) > len(above):
            raise InvalidInputError(f"{path}: {flange} does not hang on {base}")
        joints.insert(0, above[link])
        link = _link(above[link], "parent")
    turning = [joint.get("type") in ("revolute", "continuous") for joint in joints]
    if turning != [True] * 6 + [False]:
        raise InvalidInputError(f"{path}: expected six turning joints and a flange")
    placed = [_placed(joint.find("origin")) for joint in joints]
    limits = [_limits(joint, path) for joint in joints[:6]]
    lower, upper, speed = np.array(limits).T
    return UrdfChain(
        offsets_mm=readonly(np.array([offset for offset, _ in placed])),
        rotations=readonly(np.array([rotation for _, rotation in placed])),
        axes=readonly(
            np.array([_vector(joint.find("axis"), "xyz", (1, 0, 0)) for joint in joints[:6]])
        ),
        lower_rad=readonly(lower.copy()),
        upper_rad=readonly(upper.copy()),
        speed_rad_per_s=readonly(speed.copy()),
    )


def _link(joint: ElementTree.Element, end: str) -> str:
    element = joint.find(end)
    return "" if element is None else element.get("link", "")


def _vector(
    element: ElementTree.Element | None, name: str, default: tuple[float, float, float]
) -> Floats:
    text = None if element is None else element.get(name)
    if text is None:
        return np.array(default, dtype=np.float64)
    return np.array([float(word) for word in text.split()])


def _placed(origin: ElementTree.Element | None) -> tuple[Floats, Floats]:
    """Return offset (3,) in mm and rotation (3, 3) of a joint at zero."""
    offset = MM_PER_M * _vector(origin, "xyz", (0.0, 0.0, 0.0))
    turn = Rotation.from_euler("xyz", _vector(origin, "rpy", (0.0, 0.0, 0.0)))
    return offset, turn.as_matrix()


def _limits(joint: ElementTree.Element, path: str | Path) -> tuple[float, float, float]:
    limit = joint.find("limit")
    if limit is None:
        raise InvalidInputError(f"{path}: joint {joint.get('name')} has no limits")
    lower, upper, speed = (float(limit.get(key, "nan")) for key in ("lower", "upper", "velocity"))
    return lower, upper, speed
