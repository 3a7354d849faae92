"""Files of a certified motion for controllers and other programs; those of the scan."""

from collections.abc import Callable
from functools import partial

from rona_core.app.declarations.declarations import Export
from rona_core.app.dependencies.staleness import required, session_obstacles, stale_reason
from rona_core.app.steps.roll.certificate_view import plan_reason
from rona_core.app.steps.roll.inputs import ROLL
from rona_core.errors import StaleResultError, StepBlockedError
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.motion_files.certified import CertifiedMotion
from rona_core.robot.motion_files.formats import URSCRIPT, WRITERS
from rona_core.robot.verification.certificate import Certificate
from rona_core.session.document import Session

Motion = Callable[[Session], CertifiedMotion]


def motion_exports(name: str, says: str, motion: Motion) -> tuple[Export, ...]:
    """Return an export of a motion in each format."""

    def written(write: Callable[[CertifiedMotion], bytes], session: Session) -> bytes:
        return write(motion(session))

    return tuple(
        Export(f"{name}.{ending}", f"{says}: {words}", partial(written, write), "motion")
        for ending, (words, write) in WRITERS.items()
    )


def is_urscript(name: str) -> bool:
    """Return whether an export is for arms of Universal Robots alone."""
    return name.endswith(f".{URSCRIPT}")


def held(certificate: Certificate | None) -> Certificate:
    """Return a certificate.

    Raises:
        StepBlockedError: there is none.
    """
    if certificate is None:
        raise StepBlockedError("the motion was never verified: plan it again")
    return certificate


def scan_motion(session: Session) -> CertifiedMotion:
    """Return the planned motion of the scan, certified for the robot and surroundings of now.

    Its table has the way along the scan path beside each sample.

    Raises:
        StepBlockedError: there is no plan, or none that is certified; it says why.
        StaleResultError: the plan is out of date.
    """
    plan = required(ROLL, session)
    if (reason := stale_reason("roll", session)) is not None:
        raise StaleResultError(f"the plan of the scan is stale: {reason}")
    motion, certificate = plan.trajectory, held(plan.certificate)
    if motion is None or not plan.may_move:
        raise StepBlockedError(f"the robot cannot scan this path: {plan_reason(session)}")
    model = robot_model(session.setup.devices.robot.model)
    refusal = certificate.refusal(motion, model, session_obstacles(session))
    if refusal is not None:
        raise StepBlockedError(f"the robot cannot scan this path: {refusal}")
    columns = {"path_mm": motion.path_mm.tolist()}
    return CertifiedMotion(model, motion, certificate, "scan_path", columns)


EXPORTS = motion_exports("scan_motion", "certified scan", scan_motion)
