"""Results and captures as plain JSON: poses as quaternion and translation, arrays as lists."""

import dataclasses
import json
import math
from collections.abc import Mapping, Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from starlette.responses import Response

from rona_core.geometry.pose import Pose, Poses


def described(*kinds: str) -> dict[int | str, dict[str, Any]]:
    """Return what the document says of an answer: JSON of these kinds, ``object`` or ``null``."""
    schema = {"type": kinds[0] if len(kinds) == 1 else list(kinds)}
    return {200: {"content": {"application/json": {"schema": schema}}}}


class FastJson(Response):
    """JSON that is encoded where it is made, in the thread of the handler."""

    media_type = "application/json"

    def render(self, content: Any) -> bytes:
        """Encode ``content``."""
        return json.dumps(content, allow_nan=False, separators=(",", ":")).encode()


def plain(value: Any, max_points: int | None = None) -> Any:
    """Return ``value`` as JSON values.

    Args:
        value: A dataclass of the session, or what it consists of.
        max_points: Longest array along its first axis; longer ones are thinned out evenly, all
            of one length in the same way, so that rows still belong together.
    """
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, np.ndarray):
        return _plain_array(value, max_points)
    if isinstance(value, Pose):
        return {"wxyz": value.wxyz().tolist(), "translation_mm": value.translation.tolist()}
    if isinstance(value, Poses):
        return {
            "wxyz": _plain_array(value.wxyz(), max_points),
            "translations_mm": _plain_array(value.translations, max_points),
        }
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        names = (field.name for field in dataclasses.fields(value))
        return {name: plain(getattr(value, name), max_points) for name in names}
    if isinstance(value, Mapping):
        return {str(key): plain(item, max_points) for key, item in value.items()}
    return [plain(item, max_points) for item in cast("Sequence[Any]", value)]


def _plain_array(array: NDArray[Any], max_points: int | None) -> Any:
    if max_points is not None and array.ndim and len(array) > max_points:
        array = array[np.linspace(0, len(array) - 1, max_points).round().astype(int)]
    if array.dtype.kind == "f" and not np.isfinite(array).all():
        masked = array.astype(object)
        masked[~np.isfinite(array)] = None
        return masked.tolist()
    return array.tolist()
