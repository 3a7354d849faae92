"""Quick look: short lines with each probe by hand, upright and tilted, before the robot scans."""

from dataclasses import replace

import numpy as np

from rona_core.app.declarations.declarations import ActivityContext, Message
from rona_core.app.dependencies.judge import fresh
from rona_core.app.dependencies.staleness import capture_setup_digest, required
from rona_core.app.messages.message import StoreCapture
from rona_core.app.runtime.handling import computed, derive_all, strip_for_worker
from rona_core.app.runtime.recording import begin, part_of
from rona_core.app.steps.path.inputs import SMOOTHING
from rona_core.app.steps.scan.derivation import LookCapture
from rona_core.app.steps.scan.messages import StartQuickLook
from rona_core.app.steps.setup.capture_parts import LOOK_PROBES
from rona_core.devices.samples import AScanTrack
from rona_core.errors import CancelledError
from rona_core.geometry.arrays import Ints, readonly
from rona_core.geometry.path5d import Path5D
from rona_core.mapping.tilted_passes import TiltSettings, tilted_paths
from rona_core.session.document import Session
from rona_core.ultrasound.detection.probe_choice import ProbeAdvice, advise

SHOTS = 5  # A-scans of a line
PITCH_MM = 1.0
RECORDING_SHARE = 0.5  # of the time of a quick look
DEPTH_MM = 1.0  # by which the collar presses the line of the probe


def take_quick_look(
    activity: StartQuickLook, session: Session, context: ActivityContext
) -> tuple[Message, ...]:
    """Carry out `StartQuickLook`."""
    taken = capture_looks(activity, session, part_of(context, 0.0, RECORDING_SHARE))
    looked = session.with_capture("looks", taken)
    part = part_of(context, RECORDING_SHARE, 1.0 - RECORDING_SHARE)
    values = part.run(derive_all, strip_for_worker(looked), activity)
    return (StoreCapture("looks", taken), *computed(activity, values, looked))


def capture_looks(
    activity: StartQuickLook, session: Session, context: ActivityContext
) -> LookCapture:
    """Record short lines over the path with each probe, upright and tilted.

    Raises:
        CancelledError: Cancel or Stop was pressed: half a look says nothing.
    """
    path = required(SMOOTHING, session).path
    rows = line_rows(path, activity.lines)
    ways = (path, *(one.path for one in tilted_paths(path, TiltSettings())))
    places, axes = path.points_base[rows], np.array([one.axes_base[rows] for one in ways])
    ordinal = begin(session, context)
    probes = required(LOOK_PROBES, session)
    tracks: list[AScanTrack] = []
    for probe in probes:
        for towards in axes:
            if context.cancel():
                raise CancelledError("the quick look was cancelled: nothing of it is kept")
            tracks.append(context.rig.bench.record_on_bone(probe, places, towards, DEPTH_MM))
            context.progress(len(tracks) / (len(probes) * len(axes)))
    return LookCapture(
        ordinal=ordinal,
        setup_digest=capture_setup_digest("looks", session),
        probes=probes,
        tracks=tuple(tracks),
        places_base=readonly(places),
        axes_base=readonly(axes),
        lines=activity.lines,
        depth_mm=DEPTH_MM,
    )


def line_rows(path: Path5D, lines: int) -> Ints:
    """Return the points (lines * ``SHOTS``) of a path that are nearest to short lines along it.

    The lines are spread evenly over the path; each follows it.
    """
    way_mm = path.arc_length_mm()
    middles = np.linspace(0.0, way_mm[-1], lines + 2)[1:-1]
    wanted = middles[:, None] + PITCH_MM * (np.arange(SHOTS) - SHOTS // 2)
    return np.abs(way_mm - wanted.reshape(-1, 1)).argmin(axis=1)


def probe_advice(session: Session) -> ProbeAdvice | None:
    """Return what the quick look says about the probe; None without one, or where it is stale."""
    look = fresh("quick_look", session)
    if look is None:
        return None
    advice = advise(look, session.setup.devices.probe.name)
    if not advice.another:
        return advice
    words = "Choose it in step 1" + (" and scan again." if session.captures.scan else ".")
    return replace(advice, sentence=f"{advice.sentence} {words}")
