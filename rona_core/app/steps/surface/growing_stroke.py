"""Tip of the pointer while it slides over the skull: it grows from the frames that have come.

It is a view. Nothing of it goes into the session, and the capture does not know whether anybody
looks. The head counts as lying still; the cloud of step 4 knows better.
"""

from collections.abc import Sequence

import numpy as np

from rona_core.app.dependencies.references import reference_of
from rona_core.app.dependencies.staleness import required
from rona_core.app.steps.pointer.derivation import POINTER
from rona_core.app.steps.surface.derivation import tip_of
from rona_core.devices.live import LiveState
from rona_core.devices.samples import ToolTrack, TrackerFrame
from rona_core.errors import RonaError
from rona_core.geometry.arrays import Floats, readonly
from rona_core.geometry.pose import Pose
from rona_core.session.captures import PointerCapture
from rona_core.session.document import Session


class StrokeGrower:
    """Grows the stroke of one capture; each frame is looked at once."""

    def __init__(self, session: Session) -> None:
        """Prepare for a stroke that is recorded in ``session``."""
        self._session = session
        self._n_frames = 0  # that had come when it was looked last
        self._T_base_tracker: Pose | None = None
        self._tips_base: Floats = readonly(np.zeros((0, 3)))

    def grown(self, frames: Sequence[TrackerFrame]) -> Floats:
        """Return the tip (k, 3) in ``base`` in all frames so far in which the pointer was seen.

        None of them while tool or pointer are not calibrated, or the tracker was moved and is not
        found again: the builder of the cloud is notified.
        """
        new, self._n_frames = frames[self._n_frames :], len(frames)
        if new:
            try:
                tips = self._tips(new)
            except RonaError:
                return self._tips_base
            self._tips_base = readonly(np.vstack((self._tips_base, tips)))
        return self._tips_base

    def _tips(self, frames: Sequence[TrackerFrame]) -> Floats:
        pointer = self._session.setup.devices.pointer
        stroke = PointerCapture(
            ordinal=0,
            setup_digest="",
            pointer=pointer,
            marker=ToolTrack.from_frames(pointer, frames),
            base=ToolTrack.from_frames("basemarker", frames),
            tracker_place=self._session.setup.devices.tracker.place,
        )
        if self._T_base_tracker is None:
            self._T_base_tracker = reference_of(self._session, stroke).T_base_tracker
        return self._T_base_tracker @ tip_of(required(POINTER, self._session), stroke)


def replayed_pointer(session: Session, live: LiveState) -> Pose | None:
    """Return where a recording under way shows the pointer, ``T_base_pointermarker``.

    None while none is played, the tool is not seen, or the tracker is not registered.
    """
    registered = session.results.tool
    if live.origin != "REPLAY" or live.frame is None or registered is None:
        return None
    sample = live.frame.tools[0]
    if sample.T_tracker_marker is None:
        return None
    return registered.value.T_base_tracker @ sample.T_tracker_marker
