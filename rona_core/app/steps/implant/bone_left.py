"""Bone over the bed of step 10 while its milling is replayed."""

from rona_core.app.dependencies.staleness import required
from rona_core.app.steps.implant.bed_milling import robot_path_of
from rona_core.app.steps.implant.milling_motion import way_at
from rona_core.app.steps.implant.view import milling_view
from rona_core.app.steps.maps.inputs import MAPS
from rona_core.geometry.arrays import Floats
from rona_core.planning.robot_milling import BoneOverBed, bone_left, bone_over
from rona_core.session.document import Session
from rona_core.session.memo import Memo

_BONES: Memo[BoneOverBed] = Memo(2)


def bone_over_bed(session: Session) -> BoneOverBed:
    """Return the bone over the bed of step 10, and what each layer of its milling takes.

    Raises:
        StepBlockedError: there is no bed, or it does not lie wholly in the maps.
        StaleResultError: it is of other maps.
    """
    view, maps = milling_view(session), required(MAPS, session)
    return _BONES.get(
        (view, maps), lambda: bone_over(view.bed, view.path, view.placed.T_base_bed, maps.outer)
    )


def bone_left_mm(session: Session, share: float) -> Floats | None:
    """Return how high the bone is (nx, ny) in ``bed`` at a share (0 to 1) of the planned milling.

    None before a milling is planned.

    Raises:
        StepBlockedError: there is no bed, or it does not lie wholly in the maps.
        StaleResultError: it is of other maps.
    """
    way_mm = way_at(session, share)
    if way_mm is None:
        return None
    view = milling_view(session)
    return bone_left(bone_over_bed(session), view.path, robot_path_of(view), way_mm)
