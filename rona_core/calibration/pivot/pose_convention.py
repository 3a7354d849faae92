"""Convention of poses: which change of a file fits a resting tip, or a tip on bone, better.

A pivot checks the convention of its own poses: only poses of the marker in the tracker leave the
tip in one place. Each change that people make by mistake is undone in turn, tip and pivot are
fitted, and what the fits leave over is compared pose by pose (the test of [Vuong 1989] on bounded
squares, with means over blocks because neighbouring poses share their errors).

The inverse of a pivot is a pivot as well, with tip and pivot exchanged and the same residuals.
Lengths decide there: no pointer is as long as the way to its tracker. A mirror image of rotations
and translations together is a pivot too, of the mirrored pointer: no pose shows it.

A stroke over bone with a calibrated pointer is checked in the same way: its tip is known and lies
on a smooth surface, however the hand tilts the pointer. Only poses of the marker leave it there.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from rona_core.calibration.pivot.maximum_likelihood import robust_initial_guess
from rona_core.calibration.pivot.motion_extent import repeated_poses
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats, Ints, Vector3
from rona_core.geometry.pose import Poses

LONGEST_MM = 400.0  # from the markers of a hand-held pointer to its tip
LONGER = 1.5  # the way to the tracker over that to the tip, so that no error exchanges them
MOST_POSES = 2000  # more do not make the comparison surer
BLOCKS = 25
SURE = 4.0  # standard errors by which a change must fit better
OPEN = 3.0  # standard errors below which two fits are alike
BETTER = 1.1  # scatter as the file is, over that with the change undone
SAME_TIP_MM = 2.0  # two readings with tips as near as this do no harm
MOST_SCATTER_MM = 3.0  # of a fit that explains the poses, per axis
LEAST_SCATTER_MM = 1e-3
BOUND = 16.0  # squares of residuals count at most this much, in units of the scatter
MEDIAN_CHI = 1.538  # of three freedoms
MEDIAN_NORMAL = 0.6745  # of one
DEGREE = 3  # of the polynomial that a stroke of some centimetres over bone lies on
ROUNDS = 6  # of reweighting
SMOOTHER = 2.0  # as BETTER, of strokes: bone that is no polynomial is not taken for a change
FEWEST = 100  # poses of a stroke, ten for each coefficient of the polynomial


@dataclass(frozen=True, slots=True)
class Change:
    """What may have been done to poses, in words, and how to undo it."""

    words: str
    remedy: str
    undo: Callable[[Poses], Poses]
    late: int = 0  # frames by which the rotation of a pose comes after its translation


def _inverted(poses: Poses) -> Poses:
    return poses.inv()


def _transposed(poses: Poses) -> Poses:
    return Poses(np.swapaxes(poses.rotations, 1, 2), poses.translations)


def _reordered(by: int) -> Callable[[Poses], Poses]:
    def undo(poses: Poses) -> Poses:
        quaternions = np.roll(Rotation.from_matrix(poses.rotations).as_quat(), by, axis=1)
        return Poses(Rotation.from_quat(quaternions).as_matrix(), poses.translations)

    return undo


def _mirrored(axis: int) -> Callable[[Poses], Poses]:
    signs = np.where(np.arange(3) == axis, -1.0, 1.0)
    return lambda poses: Poses(poses.rotations, poses.translations * signs)


def _mirrored_rotations(axis: int) -> Callable[[Poses], Poses]:
    signs = np.where(np.arange(3) == axis, -1.0, 1.0)
    return lambda poses: Poses(signs[:, None] * poses.rotations * signs, poses.translations)


def _as_they_are(poses: Poses) -> Poses:
    return poses


_MIRROR = (
    "translations and rotations belong to frames of different handedness: the {} axis is mirrored "
    "in one of them alone",
    "change the sign of {} in the translations if the frame of the rotations is right-handed, else "
    "turn the rotations into that of the translations",
)
_ORDER = "the rotations were made from quaternions in another order: {}"

CHANGES: dict[str, Change] = {
    "inverted": Change(
        "the matrices are inverted: they are poses of the tracker in the marker",
        "write the inverse of each, the pose of the marker in the tracker",
        _inverted,
    ),
    "transposed": Change(
        "the rotations are transposed, the translations are right",
        "write each rotation row by row, its columns are the axes of the marker",
        _transposed,
    ),
    "real part first": Change(
        _ORDER.format("w x y z was read as x y z w"),
        "name the columns qw, qx, qy, qz, or make the matrices with the real part first",
        _reordered(-1),
    ),
    "real part last": Change(
        _ORDER.format("x y z w was read as w x y z"),
        "name the columns qx, qy, qz, qw, or make the matrices with the real part last",
        _reordered(1),
    ),
    **{
        f"mirrored {name}": Change(
            _MIRROR[0].format(name), _MIRROR[1].format(name), _mirrored(axis)
        )
        for axis, name in enumerate("xyz")
    },
    "rotation late": Change(
        "the rotation of each pose is that of the frame before",
        "pair each translation with the rotation of the next row",
        _as_they_are,
        late=1,
    ),
    "rotation early": Change(
        "the rotation of each pose is that of the frame after",
        "pair each translation with the rotation of the row before",
        _as_they_are,
        late=-1,
    ),
}
DIRECTION = (
    "tip and pivot could be exchanged: the origin of the poses is {:.0f} mm from the resting tip "
    "and the marker {:.0f} mm, so that they may be poses of the marker or, inverted, those of the "
    "other frame in it"
)
DIRECTION_REMEDY = (
    "record with the tracker (or the reference body) more than {:.0f} mm away, or save as .igs.mha "
    "whose field names the direction (StylusToReferenceTransform)"
)


@dataclass(frozen=True, slots=True, eq=False)
class _Reading:
    """What the poses with one change undone leave over."""

    misses_mm: Floats  # (n,) of the tip from where it should be; NaN where a pose has no partner
    scatter_mm: float  # per axis, from the median


@dataclass(frozen=True, slots=True, eq=False)
class _Resting(_Reading):
    """Tip and pivot that were fitted."""

    tip_marker: Vector3
    pivot_tracker: Vector3


@dataclass(frozen=True, slots=True, eq=False)
class _Sliding(_Reading):
    """The tip of a calibrated pointer."""

    tips_tracker: Floats  # (n, 3), NaN where a pose has no partner


def require_convention(
    Ts_tracker_marker: Poses, *, dof: int, direction_known: bool = False
) -> None:
    """Refuse the poses of a pivot that are in another convention than those of a marker.

    Poses that no change makes fit are left to the calibration, which says what is wrong with them.

    Args:
        Ts_tracker_marker: Poses (n,) in their order, that turned enough to determine a tip.
        dof: 6; or 5 where only the z axis of the marker is known and the tip lies on it.
        direction_known: Whether the file names the frames, so that lengths which could be those
            of either direction are taken as it says.

    Raises:
        InvalidInputError: a change fits better, or as well with another tip; it is named (``data``
            has its key in `CHANGES` as ``change``), with what to do.
    """
    stated = _resting(Ts_tracker_marker, dof, _as_they_are, 0)
    readings = {
        name: _resting(Ts_tracker_marker, dof, change.undo, change.late)
        for name, change in CHANGES.items()
        if dof == 5 or name != "inverted"  # of 6D it has the same residuals
    }
    readings = {k: one for k, one in readings.items() if one.scatter_mm <= MOST_SCATTER_MM}
    scale = min([stated.scatter_mm, *(one.scatter_mm for one in readings.values())])
    gains = {name: _gain(stated, one, scale) for name, one in readings.items()}
    better = [k for k in gains if gains[k] > SURE and _scatters_more(stated, readings[k])]
    if better:
        name = min(better, key=lambda k: readings[k].scatter_mm)
        raise _refusal(CHANGES[name].words, CHANGES[name].remedy, name)
    if stated.scatter_mm > MOST_SCATTER_MM:
        return
    _require_direction(stated, direction_known)
    for name, one in readings.items():
        away_mm = float(np.linalg.norm(one.tip_marker - stated.tip_marker))
        if gains[name] > -OPEN and away_mm > SAME_TIP_MM:
            raise _refusal(
                "the poses leave their convention open. As they are, or if "
                f"{CHANGES[name].words}, they fit alike, with tips {away_mm:.0f} mm apart",
                f"swing further, with more poses; if it is so, {CHANGES[name].remedy}",
                name,
            )


def require_stroke_convention(Ts_tracker_marker: Poses, tip_marker: Vector3) -> None:
    """Refuse the poses of a stroke over bone that are in another convention than those of a marker.

    A change that moves the tip by less than 2 mm does no harm and is not looked for. Strokes that
    show nothing are let through: the pointer was hardly tilted, or its tip ran along a line.

    Args:
        Ts_tracker_marker: Poses (n,) in their order.
        tip_marker: Of the calibrated pointer (3,).

    Raises:
        InvalidInputError: the tip lies clearly better on a smooth surface after a change; it is
            named (``data`` has its key in `CHANGES` as ``change``), with what to do; those that fit
            nearly as well are named after it (``alike``).
    """
    if len(Ts_tracker_marker) < FEWEST:
        return
    stated = _sliding(Ts_tracker_marker, tip_marker, _as_they_are, 0)
    better: dict[str, float] = {}
    undone = [(name, change.undo, change.late) for name, change in CHANGES.items()]
    # with a known tip it counts which of the two frames is mirrored
    undone += [
        (f"mirrored {name}", _mirrored_rotations(axis), 0) for axis, name in enumerate("xyz")
    ]
    for name, undo, late in undone:
        other = _sliding(Ts_tracker_marker, tip_marker, undo, late)
        scatter_mm = max(other.scatter_mm, LEAST_SCATTER_MM)
        away_mm = np.linalg.norm(other.tips_tracker - stated.tips_tracker, axis=1)
        if (
            scatter_mm <= MOST_SCATTER_MM
            and stated.scatter_mm > SMOOTHER * scatter_mm
            and np.nanmedian(away_mm) > SAME_TIP_MM
            and _gain(stated, other, scatter_mm) > SURE
        ):
            better[name] = min(scatter_mm, better.get(name, scatter_mm))
    if better:
        name, *others = sorted(better, key=lambda one: better[one])
        least_mm = SMOOTHER * max(better[name], LEAST_SCATTER_MM)
        alike = [one for one in others if better[one] <= least_mm]
        remedy = CHANGES[name].remedy + "".join(
            f". It may as well be that {CHANGES[one].words}: {CHANGES[one].remedy}" for one in alike
        )
        raise _refusal(CHANGES[name].words, remedy, name, alike)


def _scatters_more(stated: _Reading, other: _Reading) -> bool:
    return stated.scatter_mm > BETTER * max(other.scatter_mm, LEAST_SCATTER_MM)


def _require_direction(stated: _Resting, known: bool) -> None:
    """Refuse a pivot whose tip is as far from the marker as only a tracker is, or may be."""
    to_tip = float(np.linalg.norm(stated.tip_marker))
    to_origin = float(np.linalg.norm(stated.pivot_tracker))
    farther, nearer = max(to_tip, to_origin), min(to_tip, to_origin)
    clear = farther > LONGEST_MM and farther > LONGER * nearer
    if clear and to_tip > to_origin:
        change = CHANGES["inverted"]
        raise _refusal(
            f"{change.words}. The tip would be {to_tip:.0f} mm from the marker and "
            f"{to_origin:.0f} mm from the tracker",
            change.remedy,
            "inverted",
        )
    if not clear and not known:
        words = DIRECTION.format(to_origin, to_tip)
        raise _refusal(words, DIRECTION_REMEDY.format(LONGEST_MM), "direction")


def _refusal(words: str, remedy: str, change: str, alike: Sequence[str] = ()) -> InvalidInputError:
    text = f"{words}. {remedy[0].upper()}{remedy[1:]}"
    return InvalidInputError(text, change=change, alike=list(alike))


def _undone(poses: Poses, undo: Callable[[Poses], Poses], late: int) -> tuple[Ints, Poses]:
    """Return the poses without a change, and their rows: those that say something new."""
    n = len(poses)
    rows = np.arange(max(-late, 0), n - max(late, 0))  # of the translations that have a partner
    rows = rows[~repeated_poses(poses)[rows]]
    if len(rows) > MOST_POSES:
        rows = rows[np.linspace(0, len(rows) - 1, MOST_POSES).astype(np.int64)]
    return rows, undo(Poses(poses.rotations[rows + late], poses.translations[rows]))


def _resting(poses: Poses, dof: int, undo: Callable[[Poses], Poses], late: int) -> _Resting:
    """Fit tip and pivot after undoing a change."""
    rows, right = _undone(poses, undo, late)
    origin = right.translations.mean(axis=0)
    p = right.translations - origin
    levers = right.rotations if dof == 6 else right.rotations[:, :, 2:]
    x = robust_initial_guess(levers, p, np.ones(len(p), dtype=np.bool_))
    lengths = np.linalg.norm(levers @ x[:-3] + p - x[-3:], axis=1)
    near = lengths <= np.sqrt(BOUND) / MEDIAN_CHI * np.median(lengths) + LEAST_SCATTER_MM
    design = np.concatenate((levers, np.broadcast_to(-np.eye(3), (len(p), 3, 3))), axis=2)[near]
    x = np.linalg.lstsq(design.reshape(-1, design.shape[2]), -p[near].ravel())[0]
    lengths = np.linalg.norm(levers @ x[:-3] + p - x[-3:], axis=1)
    misses = np.full(len(poses), np.nan)
    misses[rows] = lengths
    tip = x[:3] if dof == 6 else np.array((0.0, 0.0, x[0]))
    return _Resting(misses, float(np.median(lengths)) / MEDIAN_CHI, tip, x[-3:] + origin)


def _sliding(
    poses: Poses, tip_marker: Vector3, undo: Callable[[Poses], Poses], late: int
) -> _Sliding:
    """Fit a smooth surface to the tip after undoing a change.

    It is the height over the plane of the tips, a polynomial of degree 3, by weights that bound
    the influence of a tip off the bone (Huber 2009).
    """
    rows, right = _undone(poses, undo, late)
    tips = right @ tip_marker
    centred = tips - tips.mean(axis=0)
    axes = np.linalg.svd(centred, full_matrices=False)[2]
    u, v, height = (centred @ axes.T).T
    scale = max(float(np.abs(u).max()), LEAST_SCATTER_MM)
    powers = [(i, j) for i in range(DEGREE + 1) for j in range(DEGREE + 1 - i)]
    design = np.column_stack([(u / scale) ** i * (v / scale) ** j for i, j in powers])
    weights, scatter, off = np.ones(len(tips)), 0.0, height
    for _ in range(ROUNDS):
        fit = np.linalg.lstsq(design * weights[:, None], height * weights)[0]
        off = np.abs(height - design @ fit)
        scatter = float(np.median(off)) / MEDIAN_NORMAL
        weights = np.sqrt(np.minimum(1.0, 1.5 * scatter / np.maximum(off, 1e-12)))
    misses, places = np.full(len(poses), np.nan), np.full((len(poses), 3), np.nan)
    misses[rows], places[rows] = off, tips
    return _Sliding(misses, scatter, places)


def _gain(stated: _Reading, other: _Reading, scale_mm: float) -> float:
    """Return by how many standard errors the other reading leaves less over."""
    scale = max(scale_mm, LEAST_SCATTER_MM)
    bounded = [np.minimum((r.misses_mm / scale) ** 2, BOUND) for r in (stated, other)]
    gains = bounded[0] - bounded[1]
    gains = gains[np.isfinite(gains)]
    means = np.array([part.mean() for part in np.array_split(gains, min(BLOCKS, len(gains)))])
    error = float(means.std(ddof=1)) / np.sqrt(len(means))
    return float(means.mean() / max(error, 1e-9))
