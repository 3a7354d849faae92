"""How the robot mills a bed, as a session holds it, and what to say of it."""

from dataclasses import dataclass

from rona_core.app.steps.roll.certificate_view import none_works, refused_plan
from rona_core.geometry.arrays import Floats
from rona_core.robot.redundancy.result import RollVerdict
from rona_core.robot.trajectory.trajectory import Trajectory
from rona_core.robot.verification.certificate import Certificate, is_certified


@dataclass(frozen=True, slots=True, eq=False)
class MillingPlan:
    """Verdicts on the rolls about the burr, and the motion with one of them and its certificate.

    The motion goes from home to home; at the end of every layer the robot rests above the bed, and
    may go home from there as it does at the end. The way of the trajectory is along the path of
    the robot (`RobotPath`).
    """

    model: str  # name of the robot
    verdicts: tuple[RollVerdict, ...]
    chosen: int  # into the verdicts; -1 where none will do
    trajectory: Trajectory | None
    certificate: Certificate | None
    layer_ends_s: Floats  # (layers,) at rest above the bed; empty without a motion
    changes_s: Floats  # (changes,) at rest at home, for another burr

    @property
    def may_move(self) -> bool:
        """Whether there is a motion and its certificate stands."""
        return is_certified(self.trajectory, self.certificate)

    @property
    def certified_motion(self) -> Trajectory | None:
        """The motion if its certificate stands, else None."""
        return self.trajectory if self.may_move else None


def why_no_milling(plan: MillingPlan) -> str | None:
    """Return why the robot cannot mill the bed, None where it can."""
    if plan.may_move:
        return None
    if plan.trajectory is None:
        return none_works(plan.verdicts)
    return refused_plan(plan.certificate)


def milling_verdict(plan: MillingPlan) -> str:
    """Return in one sentence whether the robot can mill the bed."""
    reason = why_no_milling(plan)
    if reason is not None or plan.trajectory is None:
        return f"The robot cannot mill this bed: {reason}."
    minutes, seconds = divmod(round(plan.trajectory.duration_s), 60)
    roll_deg = plan.verdicts[plan.chosen].roll_deg
    change = ", with a change of the burr" if len(plan.changes_s) else ""
    return (
        f"The robot can mill this bed in {minutes} min {seconds:02d} s{change}: roll "
        f"{roll_deg:.0f}°, certified."
    )


def milling_summary(plan: MillingPlan) -> str:
    """Return a few words about the plan for the list of steps."""
    if plan.trajectory is None:
        return "no roll reaches it"
    if not plan.may_move:
        return "milling refused by the verifier"
    return f"milled in {plan.trajectory.duration_s / 60.0:.0f} min"
