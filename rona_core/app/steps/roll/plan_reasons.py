"""Reasons about a plan, in words: why it cannot be driven, and what a search of the roll found."""

from collections import Counter

from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.planning.plan import RobotPlan
from rona_core.robot.redundancy.result import RollVerdict, refused_with_largest_margin
from rona_core.robot.verification.certificate import Certificate
from rona_core.session.document import Session


def plan_reason(session: Session) -> str | None:
    """Return why the planned motion cannot be driven; None where it can, or there is none."""
    searched = session.results.roll
    if searched is None:
        return None
    if searched.value.search.mode == "none":
        return "first find a roll that the robot can traverse (step 7)"
    certificate = searched.value.certificate
    if certificate is not None and not certificate.certified:
        return "the verifier refuses the motion (step 7): choose another roll"
    return superseded(session, certificate)


def superseded(session: Session, certificate: Certificate | None) -> str | None:
    """Return what to do where a plan was verified for another robot or with other tolerances."""
    if certificate is None:
        return None
    return certificate.superseded(robot_model(session.setup.devices.robot.model))


def _varying(plan: RobotPlan) -> str:
    """Return what became of a roll that varies, where one was looked for."""
    return "" if plan.search.varying is None else f"; {plan.search.varying.sentence}"


def why_no_plan(plan: RobotPlan) -> str | None:
    """Return why a plan cannot be executed, or None if it can."""
    if plan.may_move:
        return None
    if plan.search.mode == "none":
        return f"{none_works(plan.search.verdicts)}{_varying(plan)}"
    return refused_plan(plan.certificate)


def none_works(verdicts: tuple[RollVerdict, ...]) -> str:
    """Return why none of the rolls of a search works."""
    stopped = [verdict for verdict in verdicts if not verdict.feasible]
    causes = Counter(verdict.reason for verdict in stopped)
    counts = [f"{count} by {cause}" for cause, count in causes.most_common()]
    if left := len(verdicts) - len(stopped):
        counts.append(f"{left} with a smaller margin were not tried")
    details = ""
    if stopped:
        furthest = max(stopped, key=lambda verdict: verdict.index)
        details = f"; the one that gets furthest: {furthest.sentence}"
    if refused := refused_with_largest_margin(verdicts):
        details = f"; tried first: {refused.sentence}{details}"
    return f"none of {len(verdicts)} rolls works ({', '.join(counts)}){details}"


def refused_plan(certificate: Certificate | None) -> str:
    """Return why the verifier refuses a motion."""
    failures = () if certificate is None else certificate.failures()
    return "the verifier refuses the plan: " + "; ".join(check.sentence for check in failures)


def roll_summary(session: Session) -> str:
    """Return one line about the search of the roll; empty before it."""
    derived = session.results.roll
    if derived is None:
        return ""
    plan = derived.value
    feasible = sum(verdict.feasible for verdict in plan.search.verdicts)
    counts = f"{feasible} of {len(plan.search.verdicts)} roll angles feasible"
    if plan.search.mode == "none" or plan.trajectory is None:
        return f"{counts}: move the robot base or change the path"
    if plan.search.mode == "variable":
        chosen = f"varying over {plan.search.roll_variation_deg:.0f}°"
    else:
        chosen = f"{plan.search.verdicts[plan.search.chosen].roll_deg:.0f}°"
    if plan_reason(session) is not None:
        return f"{counts}, {chosen}, refused by the verifier"
    return f"{counts}, {chosen}, {plan.trajectory.times_s[-1]:.0f} s"
