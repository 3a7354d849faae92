"""The certificate of the planned motion: every check, its worst value, and where that is."""

from dataclasses import dataclass

import numpy as np

from rona_core.app.steps.roll.plan_reasons import superseded
from rona_core.robot.verification.certificate import Check
from rona_core.session.document import Session

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
        """The worst value with its unit."""
        return f"{_number(self.check.value)} {self.check.unit}".rstrip()

    @property
    def limit_words(self) -> str:
        """What is allowed, with its unit."""
        sign = "≥" if self.at_least else "≤"
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
