"""A milling path: places of the tool's tip with its axis, each with the purpose of the move."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from rona_core.devices.limits import require
from rona_core.geometry.arrays import Floats, Ints, as_points, as_unit_vectors, readonly
from rona_core.planning.milling.burr import Burr


class Move(IntEnum):
    """What a move is for."""

    RETRACT = 0  # up, over and down again in the air
    ENTRY = 1  # down along a ramp into a layer
    CUT = 2
    RIM = 3  # with the smaller burr along the rim


@dataclass(frozen=True, slots=True, eq=False)
class MillingPath:
    """Tip of the tool and its axis, which points into the bone, at each place (n) in ``bed``.

    Entry k of ``moves``, ``layers`` and ``tools`` belongs to the move that ends at place k.
    """

    tips_bed: Floats  # (n, 3) where the burr meets its own axis
    axes_bed: Floats  # (n, 3)
    moves: Ints  # (n,) of ``Move``
    layers: Ints  # (n,) counted from the top; those of the rim pass go on after the others
    tools: Ints  # (n,) which of the burrs
    burrs: tuple[Burr, ...]

    def __post_init__(self) -> None:
        tips = as_points(self.tips_bed, at_least=1, name="tips_bed")
        axes = as_unit_vectors(self.axes_bed, name="axes_bed")
        sizes = {len(a) for a in (tips, axes, self.moves, self.layers, self.tools)}
        require(len(sizes) == 1, f"all arrays of a path must be as long, not {sorted(sizes)}")
        require(bool((np.diff(self.layers) >= 0).all()), "layers of a path must not go back")
        require(bool((axes[:, 2] < 0.0).all()), "axes of a path must point into the bone")
        object.__setattr__(self, "tips_bed", readonly(tips))
        object.__setattr__(self, "axes_bed", readonly(axes))
        for name in ("moves", "layers", "tools"):
            object.__setattr__(self, name, readonly(getattr(self, name)))

    def __len__(self) -> int:
        return len(self.tips_bed)

    def bottoms_bed(self) -> Floats:
        """Return the lowest place of the burr (n, 3); of a ball that is tilted it is not its tip.

        Only balls are tilted.
        """
        radii = np.array([burr.radius_mm for burr in self.burrs])[self.tools][:, None]
        return self.tips_bed - radii * (self.axes_bed + (0.0, 0.0, 1.0))

    def part(self, first: int, end: int) -> "MillingPath":
        """Return the places from the first one up to, without, the end; at least one."""
        kept = slice(first, end)
        return MillingPath(
            self.tips_bed[kept],
            self.axes_bed[kept],
            self.moves[kept],
            self.layers[kept],
            self.tools[kept],
            self.burrs,
        )

    def followed_by(self, other: "MillingPath") -> "MillingPath":
        """Return this path and then another one with the same burrs."""
        return MillingPath(
            np.concatenate((self.tips_bed, other.tips_bed)),
            np.concatenate((self.axes_bed, other.axes_bed)),
            np.concatenate((self.moves, other.moves)),
            np.concatenate((self.layers, other.layers)),
            np.concatenate((self.tools, other.tools)),
            self.burrs,
        )

    def length_mm(self, *moves: Move) -> float:
        """Return the way of the tip in moves of some kinds; without any, of all."""
        steps = np.linalg.norm(np.diff(self.tips_bed, axis=0), axis=1)
        kept = np.isin(self.moves[1:], moves or tuple(Move))
        return float(steps[kept].sum())
