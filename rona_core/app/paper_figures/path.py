"""Figures 5 to 8 of the paper: how a path is smoothed, the probe along it, and the joints."""

from typing import TYPE_CHECKING, Any

import numpy as np

from rona_core.app.dependencies.judge import fresh
from rona_core.app.paper_figures.style import INK, SOFT, open_frame, plane, space
from rona_core.app.steps.roll.view import (
    REASON_WORDS,
    JointCurves,
    joint_curves,
    shown_roll,
    shows_varying,
)
from rona_core.app.steps.smoothing.path_view import PathView, path_view, tangent_pose
from rona_core.errors import StepBlockedError
from rona_core.geometry.arrays import Floats, Ints
from rona_core.mapping.colors import BLUE, CATEGORIES, ORANGE, VERMILLION, css
from rona_core.path.simplification.error_bound import ErrorBound, as_metric, deviations
from rona_core.path.simplification.simplify import as_keep, decimation_order
from rona_core.robot.planning.plan import RobotPlan
from rona_core.session.document import Session

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

N_POINTS = 9  # of the path that is smoothed to the end, as in the paper
APART_MM, ARROW_MM = 5.0, 4.0  # probes that are drawn, and their directions
BONE_DOTS = "#b09a6a"
STRETCH_MM = 18.0  # of the smoothed path: so long is that path
PLANE = "tangent plane of the path"
WORDS = {"k1": "K₁", "k2": "K₂", "k3": "K₃"}
UNITS = {"k1": "mm", "k2": "mm", "k3": "mm²"}


def _paths(session: Session) -> PathView:
    view = path_view(session)
    if view is None:
        raise StepBlockedError("first smooth the path (step 6)")
    return view


def draw_steps_of_smoothing(session: Session, figure: "Figure") -> None:
    """Draw how points are removed, one after the other, from nine points of the path."""
    view = _paths(session)
    simplified = fresh("smoothing", session).simplified
    metric = as_metric(simplified.metric)
    points = bent_stretch(view)
    most = ErrorBound(1e6, metric).shortcut_test(points)
    order, _ = decimation_order(points, as_keep(None, len(points)), most)
    within = [
        k
        for k in range(len(order) + 1)
        if _deviation(points, without(order[:k], len(points)), metric) <= view.tolerance_mm
    ]
    grid = figure.subplots(2, 4, sharex=True, sharey=True)
    for k, axes in enumerate(grid.flat):
        kept = without(order[:k], len(points))
        _step(axes, points, kept, None if k == 0 else int(order[k - 1]))
        d = _deviation(points, kept, metric)
        name = "P" if k == 0 else f"P{chr(0x2080 + k)}"
        words = "original" if k == 0 else f"{d:.2f} {UNITS[metric]}"
        chosen = k == max(within)
        axes.set_title(f"{name}: {words}", fontweight="bold" if chosen else "normal")
        axes.spines[:].set_color(css(VERMILLION) if chosen else INK)
        axes.spines[:].set_linewidth(1.2 if chosen else 0.5)
    grid[0, 0].margins(0.18, 0.1)
    grid[0, 0].locator_params("x", nbins=3, integer=True)
    grid[0, 0].locator_params("y", nbins=4, integer=True)
    figure.supxlabel(f"u in the {PLANE} (mm)", fontsize=6.5)
    figure.supylabel("v (mm)", fontsize=6.5)
    figure.legend(*grid[0, 1].get_legend_handles_labels(), loc="outside upper center", ncols=3)


def bent_stretch(view: PathView) -> Floats:
    """Return nine samples (9, 2) of the demonstrated path, evenly spaced, where it bends most."""
    raw, corners = view.raw_patch, view.corners_patch
    length = float(np.linalg.norm(np.diff(corners, axis=0), axis=1).sum())
    share = min(STRETCH_MM / max(length, 1e-9), 1.0)
    step = max(round(share * len(raw) / (N_POINTS - 1)), 1)
    rows = np.arange(max(len(raw) - step * (N_POINTS - 1), 1))[:, None]
    stretches = raw[np.minimum(rows + step * np.arange(N_POINTS), len(raw) - 1)]
    ways = np.linalg.norm(np.diff(stretches, axis=1), axis=2).sum(axis=1)
    chords = np.linalg.norm(stretches[:, -1] - stretches[:, 0], axis=1)
    return stretches[int(np.argmin(chords / np.maximum(ways, 1e-9)))]


def without(removed: Ints, n: int) -> Ints:
    """Return the numbers of ``n`` points that are left without some."""
    return np.setdiff1d(np.arange(n), removed)


def _deviation(points: Floats, kept: Ints, metric: str) -> float:
    found = deviations(points, kept)
    return {"k1": found.k1_mm, "k2": found.k2_mm, "k3": found.k3_mm2}[metric]


def _step(axes: "Axes", points: Floats, kept: Ints, removed: int | None) -> None:
    axes.plot(*points.T, color=SOFT, linewidth=0.6, linestyle=(0, (3, 2)), label="original path P")
    axes.plot(*points[kept].T, "o-", color=css(BLUE), markersize=2.2, label="path points left")
    if removed is not None:
        gone: dict[str, Any] = {"color": css(VERMILLION), "markersize": 3.2, "fillstyle": "none"}
        axes.plot(*points[removed], "o", label="point removed in this step", **gone)
    axes.set_aspect("equal", adjustable="box")


def draw_smoothed_path(session: Session, figure: "Figure") -> None:
    """Draw the path as demonstrated and as smoothed, side by side in its tangent plane."""
    view, metric = _paths(session), fresh("smoothing", session).simplified.metric
    left, right = figure.subplots(1, 2, sharex=True, sharey=True)
    left.plot(*view.raw_patch.T, color=css(BLUE), linewidth=0.5)
    left.set_title(f"original\n{len(view.raw_patch)} points")
    right.plot(*view.raw_patch.T, color=SOFT, linewidth=0.3, label="original")
    line: dict[str, Any] = {"color": css(ORANGE), "markeredgecolor": INK, "markeredgewidth": 0.3}
    right.plot(*view.corners_patch.T, "o-", markersize=2.4, label="smoothed", **line)
    bound = f"{WORDS[metric]}, dₛ = {view.tolerance_mm:.1f} {UNITS[metric]}"
    off = f"at most {view.k1_raw_mm:.1f} mm off"
    right.set_title(f"smoothed, {bound}\n{len(view.corners_patch)} points, {off}")
    figure.legend(*right.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    for axes in (left, right):
        plane(axes, "u (mm)", "v (mm)")
        axes.label_outer()


def draw_orientations(session: Session, figure: "Figure") -> None:
    """Draw cloud and scan path in space, and how the probe stands on the path with its roll."""
    plan, cloud = fresh("roll", session), fresh("surface", session).points_base
    path, index = plan.search.path, shown_roll(session, None) or 0
    chosen = plan.search.mode != "none"
    roll_deg = plan.search.verdicts[index].roll_deg
    poses = path.Ts_base_probe(plan.search.rolls_rad if chosen else np.deg2rad(roll_deg))
    way_mm = path.arc_length_mm()
    shown = np.searchsorted(way_mm, np.arange(0.0, way_mm[-1], APART_MM))
    out_base = tangent_pose(session, path.points_base).rotation[:, 2]
    azimuth_deg = float(np.rad2deg(np.arctan2(out_base[1], out_base[0]))) - 30.0
    axes = space(figure, np.concatenate((cloud, path.points_base)), "base", azimuth_deg)
    look: dict[str, Any] = {"color": BONE_DOTS, "linewidths": 0.0, "rasterized": True}
    axes.scatter(*cloud.T, s=0.7, label="surface points (pointer)", **look)
    axes.plot(*path.points_base.T, color=INK, label="scan path")
    varies = plan.search.mode == "variable"
    roll = "varying roll" if varies else f"roll ν = {roll_deg:.0f}°"
    places, rotations = path.points_base[shown], poses.rotations[shown]
    _directions(axes, places, -rotations[:, :, 2], css(BLUE), "normal, against the probe axis")
    _directions(axes, places, rotations[:, :, 0], css(VERMILLION), f"x of the probe, {roll}")
    figure.legend(
        *axes.get_legend_handles_labels(), loc="outside upper center", ncols=2, markerscale=4
    )


def _directions(axes: Any, places: Floats, along: Floats, color: str, label: str) -> None:
    """Draw a short line (n) from each place (n, 3) along a direction (n, 3)."""
    gap = np.full_like(places, np.nan)
    lines = np.stack((places, places + ARROW_MM * along, gap), axis=1).reshape(-1, 3)
    axes.plot(*lines.T, color=color, linewidth=0.6, label=label)


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
