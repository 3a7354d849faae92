"""Figure 8 of the paper: the six joints along the path with three rolls."""

from typing import TYPE_CHECKING, Any

import numpy as np

from rona_core.app.dependencies.judge import fresh
from rona_core.app.paper_figures.style import INK, open_frame
from rona_core.app.steps.roll.view import (
    REASON_WORDS,
    JointCurves,
    joint_curves,
    shown_roll,
    shows_varying,
)
from rona_core.errors import StepBlockedError
from rona_core.mapping.colors import CATEGORIES, VERMILLION, css
from rona_core.robot.planning.plan import RobotPlan
from rona_core.session.document import Session

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

OF_THE_JOINTS = ("limit", "singularity", "jump", "reach")  # failures that joint angles show
APART_DEG = 10.0  # of rolls beside the chosen one, where none fails; as in the paper
LOW, HIGH = -12.0, 112.0  # of the axis, in percent


def draw_joints(session: Session, figure: "Figure") -> None:
    """Draw the joints, as share of their range, for the chosen roll and one on each side of it."""
    plan: RobotPlan = fresh("roll", session)
    shown = three_rolls(plan, shown_roll(session, None) or 0)
    rows = figure.subplots(len(shown), 1, sharex=True, sharey=True)
    for letter, axes, wanted in zip("abc", rows, shown, strict=True):
        curves = joint_curves(session, wanted)
        if curves is None:
            raise StepBlockedError("first search the roll (step 7)")
        _joints(axes, curves)
        index = shown_roll(session, wanted) or 0
        axes.set_title(f"({letter}) {_title(plan, curves, index, wanted)}")
    rows[1].set_ylabel("joint angle (% of the joint's range)")
    rows[-1].set_xlabel("position along the scan path (%)")
    found = [axes.get_legend_handles_labels() for axes in rows]
    key = {name: line for lines, names in found for line, name in zip(lines, names, strict=True)}
    figure.legend(list(key.values()), list(key), loc="outside lower center", ncols=4)


def three_rolls(plan: RobotPlan, middle: int) -> tuple[int | None, ...]:
    """Return the indices of three rolls: below the chosen one, it (None: as planned), and above.

    Beside it are the nearest ones that the joints rule out, else those 10 degrees off.
    """
    verdicts = plan.search.verdicts
    degrees = np.array([one.roll_deg for one in verdicts])
    away = np.mod(degrees - degrees[middle] + 180.0, 360.0) - 180.0
    fails = np.array([one.reason in OF_THE_JOINTS for one in verdicts])

    def beside(sign: float) -> int:
        there = sign * away > 1e-6
        if (there & fails).any():
            return int(np.argmin(np.where(there & fails, sign * away, np.inf)))
        return int(np.argmin(np.abs(away - sign * APART_DEG)))

    return beside(-1.0), None, beside(1.0)


def _title(plan: RobotPlan, curves: JointCurves, index: int, wanted: int | None) -> str:
    if wanted is None and shows_varying(plan, wanted):
        return f"roll varying over {curves.variation_deg:.0f}°: chosen"
    reason = REASON_WORDS[plan.search.verdicts[index].reason]
    if not curves.feasible:
        joint = f", joint {curves.worst_joint}" if curves.worst_joint else ""
        return (
            f"roll ν = {curves.roll_deg:.0f}°: {reason}{joint}, from {curves.worst_percent:.0f} %"
        )
    chosen = ", chosen" if wanted is None and plan.search.mode != "none" else ""
    return f"roll ν = {curves.roll_deg:.0f}°: {reason}{chosen}"


def _joints(axes: "Axes", curves: JointCurves) -> None:
    span = curves.upper_deg - curves.lower_deg
    shares = 100.0 * (curves.joints_deg - curves.lower_deg) / span
    x = curves.path_percent
    for number, (share, color) in enumerate(zip(shares.T, CATEGORIES, strict=True), start=1):
        axes.plot(x, np.clip(share, LOW, HIGH), color=css(color), label=f"J{number}")
    shade: dict[str, Any] = {"color": css(VERMILLION), "alpha": 0.18, "linewidth": 0.0}
    for beyond in ((LOW, 0.0), (100.0, HIGH)):
        axes.axhspan(*beyond, label="beyond a joint's limits", **shade)
    if curves.fails is not None:
        shade |= {"color": INK, "alpha": 0.14, "step": "mid", "where": curves.fails}
        axes.fill_between(x, LOW, HIGH, label="cannot be followed", **shade)
    axes.set_xlim(0.0, 100.0)
    axes.set_ylim(LOW, HIGH)
    axes.set_yticks((0, 50, 100))
    open_frame(axes)
