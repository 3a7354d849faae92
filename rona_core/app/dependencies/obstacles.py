"""What stands around the robot, as far as a session knows: measured, registered or set up."""

from collections.abc import Callable

import numpy as np

from rona_core.calibration.hand_eye.tool_registration import ToolRegistration
from rona_core.calibration.surface_registration import SurfaceRegistration
from rona_core.devices.workcell import workcell_pose
from rona_core.errors import DegenerateGeometryError
from rona_core.geometry.arrays import Vector3
from rona_core.geometry.surface.cloud import SurfaceCloud
from rona_core.robot.collision.obstacles import (
    Obstacle,
    Obstacles,
    added_boxes,
    head_as_placed,
    head_from_cloud,
    head_from_mesh,
    table_and_floor,
    tracker_stand,
)
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.session.captures import PointerCapture
from rona_core.session.document import Session
from rona_core.session.memo import Memo
from rona_core.session.specimen import LoadedSkull

UP = np.array((0.0, 0.0, 1.0))

_KNOWN: Memo[Obstacles] = Memo(16)


def obstacles_of(session: Session, fresh: Callable[[str], bool]) -> Obstacles:
    """Return everything that the robot is to keep away from, in ``base``.

    The head is the registered skull of a file, else what a large head could be under the measured
    patch, else a large head at its place in the set-up. Equal inputs give the same value.

    Args:
        session: Set-up, captures and results.
        fresh: Maps a result's name to whether it is there and not stale; stale ones are not used.
    """
    results, setup = session.results, session.setup
    tool = results.tool.value if results.tool and fresh("tool") else None
    cloud = results.surface.value if tool and results.surface and fresh("surface") else None
    skull = results.registration
    usable = cloud and skull and skull.value.verdict != "bad" and fresh("registration")
    found = skull.value if usable and skull else None
    parts = (
        setup.surroundings,
        setup.devices.robot,
        setup.specimen,
        tool,
        cloud,
        found,
        session.captures.surface,
    )
    return _KNOWN.get(parts, lambda: _build(session, tool, cloud, found))


def _build(
    session: Session,
    tool: ToolRegistration | None,
    cloud: SurfaceCloud | None,
    found: SurfaceRegistration | None,
) -> Obstacles:
    settings = session.setup.surroundings
    robot = session.setup.devices.robot
    room, work_room = workcell_pose(robot), np.array(robot_model(robot.model).work_area.region_base)
    head, sentence = _head(session, room @ work_room, tool, cloud, found)
    stand = () if tool is None else tracker_stand(settings, tool.T_base_tracker)
    return Obstacles(
        things=(
            head,
            *table_and_floor(settings, room, work_room),
            *stand,
            *added_boxes(settings, room),
        ),
        self_margin_mm=settings.self_margin_mm,
        sentence=sentence,
    )


def _head(
    session: Session,
    work_base: Vector3,
    tool: ToolRegistration | None,
    cloud: SurfaceCloud | None,
    found: SurfaceRegistration | None,
) -> tuple[Obstacle, str]:
    settings, skull = session.setup.surroundings, session.setup.specimen
    keep = settings.head_margin_mm
    if tool is not None and cloud is not None:
        try:
            if found is not None and isinstance(skull, LoadedSkull):
                vertices, T_base_skull = skull.mesh_vertices_skull, found.T_b_a.inv()
                head = head_from_mesh(vertices, T_base_skull, cloud.points_base, keep)
                return head, "Head: convex hull of the registered skull and of the touched points."
            outward = _outward(tool, cloud, session.captures.surface)
            head = head_from_cloud(cloud.points_base, outward, keep)
            return head, "Head: all that a large head could be under the touched patch."
        except DegenerateGeometryError as error:
            why = f" ({error})"
    else:
        why = " (not touched yet)"
    below = np.array((0.0, 0.0, settings.head_below_mm))
    head = head_as_placed(work_base - below, keep)
    return head, f"Head: a large head at its place in the set-up{why}."


def _outward(
    tool: ToolRegistration, cloud: SurfaceCloud, strokes: tuple[PointerCapture, ...]
) -> Vector3:
    """Return the direction from the patch to where the markers of the pointer were; else up."""
    seen = [stroke.marker.Ts_tracker_marker.translations for stroke in strokes]
    markers = [places for places in seen if len(places)]
    if not markers:
        return UP
    way = tool.T_base_tracker @ np.vstack(markers).mean(axis=0) - cloud.points_base.mean(axis=0)
    length_mm = float(np.linalg.norm(way))
    return way / length_mm if length_mm > 0.0 else UP
