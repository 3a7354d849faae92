"""Where on a ball burr bone is cut: near its pole the cutting speed is next to nothing.

Cut anew, apart from the removal of the product: at every place along the path the cells that the
ball lowers, each with the direction from the middle of the ball.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.metric import Metric, Progress
from rona_core.geometry.arrays import Floats
from rona_core.planning.implants.implant import Implant
from rona_core.planning.implants.solids import Stack, cylinder
from rona_core.planning.milling.burr import MillingSettings
from rona_core.planning.milling.milling_path import MillingPath, Move
from rona_core.planning.milling.plan_milling import plan_milling

DIAMETER_MM, DEPTH_MM = 12.0, 1.6
CELL_MM, STEP_MM = 0.05, 0.1
CAP_DEG = 5.0  # round the pole: there the speed is less than a tenth of that of the equator
THIN_MM = 1e-3  # chips that are thinner are rounding of the cells


@dataclass(frozen=True, slots=True)
class PoleCuts:
    """What the pole of the burrs cuts along one path."""

    alone: int  # places at which nothing but the cap round the pole cuts
    share: float  # of all removed bone that the cap cuts
    finished: float  # of the area that was finished last by the cap


def metrics(progress: Progress) -> Iterator[Metric]:
    """Yield what the pole cuts with tilt and without."""
    implant = Implant("disc", Stack((cylinder(DIAMETER_MM, 0.0, DEPTH_MM),)))
    tilted = MillingSettings()
    for name, settings, goal in (
        (f"tilt {tilted.tilt_deg:g} deg", tilted, 0.0),
        ("upright", replace(tilted, tilt_deg=0.0), None),
    ):
        progress(f"pole of the burr, {name}")
        found = pole_cuts(plan_milling(implant, settings))
        yield Metric(f"places where the pole alone cuts, {name}", found.alone, "", "lower", goal)
        yield Metric(f"bone cut by the pole, {name}", 100 * found.share, "%", "lower", goal)
        yield Metric(f"area finished by the pole, {name}", 100 * found.finished, "%", "lower", goal)


def pole_cuts(path: MillingPath) -> PoleCuts:
    """Return what the cap round the pole of the burrs cuts along a path."""
    half = 0.5 * DIAMETER_MM + 1.0
    axis = np.arange(-half, half + 1e-9, CELL_MM)
    surface = np.zeros((len(axis), len(axis)))
    by_cap = np.zeros(surface.shape, dtype=np.bool_)
    alone, cut_mm, cap_mm = 0, 0.0, 0.0
    for middle, pole, radius in _balls(path):
        i, j = (slice(*np.searchsorted(axis, (c - radius, c + radius))) for c in middle[:2])
        dx, dy = (axis[i] - middle[0])[:, None], (axis[j] - middle[1])[None, :]
        drop = np.sqrt(np.maximum(radius**2 - dx**2 - dy**2, 0.0))
        chip = np.where(drop > 0.0, surface[i, j] - (middle[2] - drop), 0.0)
        cuts = chip > THIN_MM
        if not cuts.any():
            continue
        cosines = (dx * pole[0] + dy * pole[1] - drop * pole[2]) / radius
        cap = cuts & (cosines > np.cos(np.deg2rad(CAP_DEG)))
        alone += bool((cap == cuts).all())
        cut_mm += float(chip[cuts].sum())
        cap_mm += float(chip[cap].sum())
        surface[i, j] = np.where(cuts, surface[i, j] - chip, surface[i, j])
        by_cap[i, j] = np.where(cuts, cap, by_cap[i, j])
    return PoleCuts(alone, cap_mm / cut_mm, float(by_cap.sum() / (surface < 0.0).sum()))


def _balls(path: MillingPath) -> Iterator[tuple[Floats, Floats, float]]:
    """Yield middle (3,), pole (3,) and radius of the ball along all moves that cut."""
    radii = np.array([burr.radius_mm for burr in path.burrs])[path.tools]
    middles = path.tips_bed - radii[:, None] * path.axes_bed
    for k in np.flatnonzero(path.moves != Move.RETRACT):
        n = max(1, int(np.ceil(np.linalg.norm(middles[k] - middles[k - 1]) / STEP_MM)))
        for share in (np.arange(n) + 1.0) / n:
            pole = path.axes_bed[k - 1] + share * (path.axes_bed[k] - path.axes_bed[k - 1])
            middle = middles[k - 1] + share * (middles[k] - middles[k - 1])
            yield middle, pole / np.linalg.norm(pole), float(radii[k])
