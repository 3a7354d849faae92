"""Reasons about a plan in words, and its certificate check by check."""

from collections import Counter
from dataclasses import dataclass

import numpy as np

from rona_core.app.declarations.figures import FIGURES
from rona_core.app.steps.roll.messages import TakeMotion
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.planning.plan import RobotPlan
from rona_core.robot.redundancy.result import RollVerdict, refused_with_largest_margin
from rona_core.robot.verification.certificate import Certificate, Check
from rona_core.session.document import Session

DURATION, CLEARANCE = FIGURES["scan_duration_s"], FIGURES["min_clearance_mm"]
NO_CLEARANCE = "Clearance was not checked: it is checked where all else holds"


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
    if plan.search.mode == "variable" and derived.message == TakeMotion.__name__:
        chosen = "imported motion"
    elif plan.search.mode == "variable":
        chosen = f"varying over {plan.search.roll_variation_deg:.0f}°"
    else:
        chosen = f"{plan.search.verdicts[plan.search.chosen].roll_deg:.0f}°"
    if plan_reason(session) is not None:
        return f"{counts}, {chosen}, refused by the verifier"
    return f"{counts}, {chosen}, {DURATION.words(float(plan.trajectory.times_s[-1]))}"


ROUNDING, SMALL = 1e-9, 1e-3


@dataclass(frozen=True, slots=True)
class CheckPlace:
    """One check, and where in the motion its worst value is."""

    check: Check
    at_least: bool  # the limit is one from below
    share: float  # of the duration, 0 to 1
    time_s: float
    path_percent: float | None  # None while the robot comes or goes

    @property
    def place(self) -> str:
        """Say where, in words."""
        if self.path_percent is None:
            return f"at {self.time_s:.1f} s, off the path"
        return f"at {self.time_s:.1f} s, path {self.path_percent:.0f} %"

    @property
    def value_words(self) -> str:
        """The worst value with its unit; a clearance as the figure of all of them is shown."""
        if self.check.name.startswith("clearance"):
            return CLEARANCE.words(self.check.value, None if self.check.holds else self.check.limit)
        return f"{_number(self.check.value)} {self.check.unit}".rstrip()

    @property
    def limit_words(self) -> str:
        """What is allowed, with its unit."""
        sign = "≥" if self.at_least else "≤"
        if self.check.name.startswith("clearance"):
            return f"{sign} {CLEARANCE.words(self.check.limit)}"
        return f"{sign} {_number(self.check.limit)} {self.check.unit}".rstrip()


@dataclass(frozen=True, slots=True)
class CertificateView:
    """What the verifier says of the planned motion."""

    certified: bool
    duration_s: float
    min_clearance_mm: float | None
    rows: tuple[CheckPlace, ...]  # those that fail first

    @property
    def failures(self) -> tuple[CheckPlace, ...]:
        """Return what does not hold."""
        return tuple(row for row in self.rows if not row.check.holds)


def _number(value: float) -> str:
    """Return at most four digits; what only rounding keeps from 0 is 0."""
    size = abs(value)
    if size < ROUNDING:
        return "0"
    if size < SMALL:
        return f"{value:.1g}"
    return f"{value:.{0 if size >= 1000 else 1 if size >= 10 else 2 if size >= 0.1 else 3}f}"


def certificate_view(session: Session) -> CertificateView | None:
    """Return the certificate of the planned motion; None where no motion is planned."""
    searched = session.results.roll
    plan = None if searched is None else searched.value
    if plan is None or plan.trajectory is None or plan.certificate is None:
        return None
    motion = plan.trajectory
    end_s, whole_mm = float(motion.times_s[-1]), max(float(motion.path_mm[-1]), 1e-9)
    rows: list[CheckPlace] = []
    for check in plan.certificate.checks:
        sample = min(max(check.index, 0), len(motion.times_s) - 1)
        time_s = float(motion.times_s[sample])
        on_path = motion.scan_start_s <= time_s <= motion.scan_end_s
        percent = 100.0 * float(np.asarray(motion.path_mm)[sample]) / whole_mm
        rows.append(
            CheckPlace(
                check=check,
                at_least="at least" in check.sentence,
                share=time_s / max(end_s, 1e-9),
                time_s=time_s,
                path_percent=percent if on_path else None,
            )
        )
    rows.sort(key=lambda row: row.check.holds)
    return CertificateView(
        certified=plan.may_move and superseded(session, plan.certificate) is None,
        duration_s=end_s,
        min_clearance_mm=plan.certificate.min_clearance_mm,
        rows=tuple(rows),
    )
