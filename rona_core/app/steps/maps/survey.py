"""What detection gets from a scan: the same from either pass of the robot and from one by hand."""

from dataclasses import dataclass
from typing import Literal, Protocol

from rona_core.app.steps.acoustics.derivation import first_speed, session_probe
from rona_core.devices.protocols import Cancel, Progress
from rona_core.devices.samples import AScanTrack
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Poses
from rona_core.session.document import Session
from rona_core.ultrasound.detection.detect import Detection, detect
from rona_core.ultrasound.probe.probe_model import ProbeSurvey


class DetectionChoice(Protocol):
    """What a message that asks for detection says of it."""

    @property
    def method(self) -> Literal["subtract", "matched", "threshold"]:
        """The detector."""
        ...

    @property
    def sound_speed_mm_per_us(self) -> float | None:
        """The speed of sound in bone; None: the calibrated one, else the published one."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Survey:
    """A-scans (n), and where the probe was at each of them, in any frame that stands still."""

    scans: AScanTrack
    poses: Poses  # (n,) of the probe
    known_standoff_mm: Floats | None = None  # (n,) to the outer boundary, see ``ProbeSurvey``


def detect_survey(
    session: Session,
    survey: Survey,
    message: DetectionChoice,
    *,
    progress: Progress,
    cancel: Cancel,
) -> Detection:
    """Find both boundaries with all that the session knows of probe, line, speed and places.

    Raises:
        InvalidInputError: A-scans of another probe, or poses that are not finite.
        CancelledError: ``cancel`` said so.
    """
    return detect(
        ProbeSurvey(
            survey.scans,
            session_probe(session),
            session.setup.devices.probe.excitation,
            positions_mm=survey.poses.translations,
            axes=survey.poses.rotations[:, :, 2],
            known_standoff_mm=survey.known_standoff_mm,
        ),
        method=message.method,
        sound_speed_mm_per_us=first_speed(message.sound_speed_mm_per_us),
        progress=progress,
        cancel=cancel,
    )
