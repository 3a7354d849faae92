"""The echo of the layers under each ray of a beam: line, gel, table, diploe, table, brain.

Exact in the layers, all multiples included. The usual way counts with 24 bits, for sines of such
numbers are thirty times as fast; the exact one with 53, to hold the other against.

How the beam spreads on its way through the bone, beside that on the face of the line. Bone is as
far as a way ``d c / c_line`` in the line (paraxial): the field of the disc there, squared by
reciprocity, over that on the face. The plain delay and loss of the way are left out.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.ultrasound.probe.beam import Beam, disc_field
from rona_core.ultrasound.probe.materials import Complexes, Material
from rona_core.ultrasound.probe.probe_model import ProbeModel
from rona_core.virtual.acoustics.layered_reflection import Boundary, ObliqueFactors, ramp, step
from rona_core.virtual.acoustics.medium import Medium
from rona_core.virtual.acoustics.microstructure import (
    AXIAL_CELL_MM,
    RMS,
    local_speed_factors,
    texture,
)

DEPTHS_MM = np.linspace(0.0, 36.0, 13)  # in the line; the last is 20 mm of bone
FREQUENCIES = 24  # at which the field is counted; it is interpolated between them


class Spreading:
    """Factors of the rays' echoes of boundaries behind the face."""

    def __init__(self, probe: ProbeModel, beam: Beam) -> None:
        """Count the field behind the face of a probe at the rays of its beam."""
        self._line_mm_per_us = probe.line.speed_mm_per_us
        radii, rings = np.unique(np.hypot(*beam.points_mm.T).round(9), return_inverse=True)
        self.rings: Ints = np.asarray(rings, dtype=np.int64)  # of the rays (n,)
        f = beam.frequencies_mhz
        some = np.linspace(f[0], f[-1], FREQUENCIES)
        k, size = probe.line.wavenumber_per_mm(some), probe.aperture_radius_mm
        fields = np.array(
            [
                np.exp(1j * k * depth) * disc_field(size, probe.line_length_mm + depth, radii, k)
                for depth in DEPTHS_MM
            ]
        )
        share = ((fields / fields[0]) ** 2).reshape(-1, FREQUENCIES)
        between = [
            np.interp(f, some, row.real) + 1j * np.interp(f, some, row.imag) for row in share
        ]
        self._table: Complexes = np.array(between).reshape(len(DEPTHS_MM), len(radii), len(f))

    def at(self, bone_mm: Floats, speed_mm_per_us: float) -> Complexes:
        """Return the factors (n, rings, f) behind ways (n,) through bone of a speed."""
        depth = np.clip(bone_mm * speed_mm_per_us / self._line_mm_per_us, 0.0, DEPTHS_MM[-1])
        place = depth / DEPTHS_MM[1]
        low = np.minimum(place.astype(np.int64), len(DEPTHS_MM) - 2)
        share = (place - low)[:, None, None]
        return (1.0 - share) * self._table[low] + share * self._table[low + 1]


SPECKLE_CELLS = 54  # of diploe, 8 mm deep
AT_ONCE = 4  # profiles that are worked on together: arrays of more leave the cache
GAP_LIMIT_MM = 4.0  # a ray further than this from the bone is lost
Phasors = NDArray[np.complexfloating]
There = Callable[[Floats], Phasors]  # distances (n,) to exp(-2 j k d), shape (n, f)


@dataclass(frozen=True, slots=True, eq=False)
class LayerProfile:
    """What each ray of the beam (n,) meets, all along the probe axis, in millimetres."""

    outer_mm: Floats  # face of the uncompressed line to bone; negative where the bone is inside it
    table_mm: Floats
    diploe_mm: Floats
    inner_table_mm: Floats
    hit: Bools  # False: the ray misses the bone
    entries_skull: Floats  # (n, 3) where the rays enter the bone, names the cells of the texture
    outer_angle_rad: Floats | None = None  # of incidence, in the gel; None: perpendicular
    inner_angle_rad: Floats | None = None  # of incidence on the inner boundary, in the bone


def echo_bands(
    weights: Phasors, line: Phasors, gel: Phasors, bone: Phasors, face: Phasors, count: int = 1
) -> Phasors:
    """Return k echoes (k, f): rays (k n, f) with a phase in line and gel, bone behind them, added.

    Args:
        weights: Area times squared incident field.
        line: exp(-2 j k d) for the change of the line's length.
        gel: exp(-2 j k d) for the gap filled with gel.
        bone: Reflection of the bone seen from the gel.
        face: Reflection (f,) of the step from line to gel.
        count: How many echoes, k, of n rays each.
    """
    behind = gel * bone
    below = face * behind
    below += 1.0
    np.multiply(1.0 - face**2, behind, out=behind)
    seen = quotient(behind, below)
    seen += face
    waves = weights * line
    waves *= seen
    return np.sum(waves.reshape(count, -1, waves.shape[1]), 1)


def quotient(above: Phasors, below: Phasors) -> Phasors:
    """Return above / below in the place of ``above``.

    It goes by way of the conjugate: nothing here is near the range of numbers.
    """
    if below.dtype != np.complex64:
        return np.divide(above, below, out=above)
    power = below.real**2
    power += below.imag**2
    above *= np.conj(below, out=below)
    above *= np.reciprocal(power, out=power)
    return above


def there_and_back(k_per_mm: Complexes, exact: bool) -> There:
    """Return what a distance does to a wave of these wavenumbers (f,), there and back."""
    if exact:
        rate = -2j * k_per_mm
        return lambda distances_mm: np.exp(np.multiply.outer(distances_mm, rate))
    turn, fade = ((2.0 * part).astype(np.float32) for part in (-k_per_mm.real, k_per_mm.imag))
    lossless = not fade.any()

    def fast(distances_mm: Floats) -> Phasors:
        distance = distances_mm.astype(np.float32)[:, None]
        angle = distance * turn
        result = np.zeros(angle.shape, dtype=np.complex64)
        if lossless:
            np.cos(angle, out=result.real)
            np.sin(angle, out=result.imag)
            return result
        faded = distance * fade
        np.exp(faded, out=faded)
        np.multiply(np.cos(angle), faded, out=result.real)
        np.multiply(np.sin(angle, out=angle), faded, out=result.imag)
        return result

    return fast


@dataclass(frozen=True, slots=True, eq=False)
class _Edge:
    """A boundary with as many bits as the rest; see ``layers.Boundary``."""

    near: Phasors
    far: Phasors
    through: Phasors

    def seen_with(self, beyond: Phasors) -> Phasors:
        below = self.far * beyond
        np.subtract(1.0, below, out=below)
        seen = quotient(self.through * beyond, below)
        seen += self.near
        return seen


@dataclass(frozen=True, slots=True, eq=False)
class _Rays:
    """What rays (m,) meet once the bone is as rough and slow as it is; lengths in millimetres."""

    grain: NDArray[np.floating]  # (m, cells) of the diploe along each ray, none where it is even
    outer_mm: Floats
    gel_mm: Floats
    table_mm: Floats
    diploe_mm: Floats
    inner_table_mm: Floats
    front: Phasors  # factors of the oblique echoes over those met perpendicular, real numbers
    passage: Phasors
    back: Phasors
    kept: Bools  # they meet the bone
    to_step_mm: Floats  # means over the rays of a profile
    to_inner_mm: Floats

    def part(self, rows: slice) -> "_Rays":
        return _Rays(*(getattr(self, field.name)[rows] for field in fields(self)))


class BoneStack:
    """The layers of one medium behind one delay line, prepared for a set of frequencies."""

    def __init__(
        self,
        line: Material,
        medium: Medium,
        frequencies_mhz: Floats,
        *,
        film_mm: float,
        seed: int,
        spreading: Spreading | None = None,
        exact: bool = False,
    ) -> None:
        """Prepare everything that does not depend on the rays.

        Args:
            line: Material of the delay line.
            medium: Gel and bone.
            frequencies_mhz: Shape (f,), above 0.
            film_mm: Gel that always remains between line and bone.
            seed: Which texture, and which local speeds.
            spreading: Of the beam in the bone; None: it does not spread.
            exact: Count with 53 bits.
        """
        f, self.medium, self.film_mm, self.seed = frequencies_mhz, medium, film_mm, seed
        self._spreading = spreading
        self._real = np.float64 if exact else np.float32
        number = np.complex128 if exact else np.complex64
        materials = (line, medium.gel, medium.table, medium.diploe)
        k = [material.wavenumber_per_mm(f) for material in materials]
        self._line, self._gel, self._table, self._diploe = (there_and_back(x, exact) for x in k)
        gel, table = medium.gel.impedance(f), medium.table.impedance(f)
        self._face = step(line.impedance(f), gel).near.astype(number)

        def edge(exact: Boundary) -> _Edge:
            return _Edge(*(part.astype(number) for part in (exact.near, exact.far, exact.through)))

        self._outer = edge(step(gel, table))
        self._into_diploe = edge(ramp(medium.table, medium.diploe, medium.ramp_mm, f))
        self._into_table = edge(ramp(medium.diploe, medium.table, medium.ramp_mm, f))
        # roughness too fine to be a ray's own lowers what stays coherent (Eckart 1953)
        fine = 2.0 * (1.0 - RMS**2)
        outer2, inner2 = (r**2 for r in (medium.outer_roughness_mm, medium.inner_roughness_mm))
        in_gel, in_bone = k[1].real, k[2].real
        self._front_loss, passed, back = (
            np.exp(-fine * square).astype(self._real)
            for square in (
                in_gel**2 * outer2,
                (in_gel - in_bone) ** 2 * outer2,
                in_bone**2 * inner2,
            )
        )
        self._passed = self._outer.through * passed
        self._inner = step(table, medium.brain.impedance(f)).near.astype(number) * back
        self._outside = ObliqueFactors(medium.gel, medium.table)
        self._inside = ObliqueFactors(medium.brain, medium.table)
        depth = (np.arange(SPECKLE_CELLS) + 0.5) * AXIAL_CELL_MM
        self._depths = depth
        # row by row real and imaginary parts in turn, so that one real product does both
        speckle = medium.speckle * np.exp(-2j * k[3][None, :] * depth[:, None])
        self._speckle = np.ascontiguousarray(speckle.astype(number)).view(self._real)
        self._number = number

    def front(self, weights: Phasors) -> Phasors:
        """Return the echo (f,) of endless bone, perpendicular, behind the film of gel."""
        film = np.full(1, self.film_mm)
        bone = self._outer.near[None, :]
        return echo_bands(weights, self._line(-film), self._gel(film), bone, self._face)[0]

    def echo(self, weights: Phasors, profile: LayerProfile) -> Phasors:
        """Return the echo (f,) of the layers under rays of these weights (n, f)."""
        return next(self.echoes(weights, (profile,)))

    def echoes(self, weights: Phasors, profiles: Sequence[LayerProfile]) -> Iterator[Phasors]:
        """Yield the echo (f,) of each profile under rays of these weights (n, f)."""
        rays, n = self._rays(profiles), len(weights)
        for start in range(0, len(profiles), AT_ONCE):
            count = min(AT_ONCE, len(profiles) - start)
            some = rays.part(slice(n * start, n * (start + count)))
            yield from self._echoes(np.tile(weights, (count, 1)), some, count)

    def _rays(self, profiles: Sequence[LayerProfile]) -> _Rays:
        """Return what the rays (m,) of all profiles meet, as rough and slow as the bone is."""
        medium = self.medium
        outer_mm, table_mm, diploe_mm, inner_mm = (
            np.concatenate([getattr(profile, name) for profile in profiles])
            for name in ("outer_mm", "table_mm", "diploe_mm", "inner_table_mm")
        )
        entries_skull = np.concatenate([profile.entries_skull for profile in profiles])
        none = np.zeros(len(profiles[0].outer_mm))  # perpendicular
        at_outer = np.concatenate(
            [none if (a := p.outer_angle_rad) is None else a for p in profiles]
        )
        at_inner = np.concatenate(
            [none if (a := p.inner_angle_rad) is None else a for p in profiles]
        )
        n = len(none)
        mean_step, mean_bone = (
            np.repeat(lengths.reshape(-1, n).mean(axis=1), n)
            for lengths in (table_mm, table_mm + diploe_mm + inner_mm)
        )
        count = SPECKLE_CELLS if medium.speckle > 0.0 else 0
        fields = texture(entries_skull, self.seed, 2 + count)
        rms_mm = medium.outer_roughness_mm, medium.inner_roughness_mm
        rough: Floats = fields[:, :2].astype(np.float64) * rms_mm
        grain = fields[:, 2:].astype(self._real)
        slow = 1.0 / local_speed_factors(entries_skull, self.seed, medium.local_speed_sd)
        diploe = slow * diploe_mm - medium.ramp_mm
        grain[self._depths[:count] > diploe[:, None]] = 0.0
        half_ramp = medium.ramp_mm / 2.0
        outer = outer_mm + rough[:, 0]
        return _Rays(
            grain=grain,
            outer_mm=outer,
            gel_mm=np.maximum(outer, self.film_mm),
            table_mm=slow * (table_mm - rough[:, 0]) - half_ramp,
            diploe_mm=diploe,
            inner_table_mm=slow * (inner_mm + rough[:, 1]) - half_ramp,
            front=self._outside.front(at_outer).astype(self._number),
            passage=self._outside.passage(at_outer).astype(self._number),
            back=self._inside.back(at_inner).astype(self._number),
            kept=np.concatenate([profile.hit for profile in profiles]) & (outer < GAP_LIMIT_MM),
            to_step_mm=mean_step,
            to_inner_mm=mean_bone,
        )

    def _spread(self, rays: _Rays, count: int) -> tuple[Phasors, Phasors] | None:
        """Return what the beam loses to the diploe, and further to the inner boundary (k n, f)."""
        if self._spreading is None:
            return None
        rings, n = self._spreading.rings, len(rays.kept) // count
        speed = self.medium.table.speed_mm_per_us
        step, inner = (
            self._spreading.at(way[::n], speed) for way in (rays.to_step_mm, rays.to_inner_mm)
        )
        parts = (part.astype(self._number)[:, rings] for part in (step, inner / step))
        first, further = (part.reshape(count * n, -1) for part in parts)
        return first, further

    def _echoes(self, weights: Phasors, rays: _Rays, count: int) -> Phasors:
        """Return the echoes (k, f) of k profiles under all their rays (k n)."""
        bone = self._inner * self._table(rays.inner_table_mm)
        bone *= rays.back[:, None]
        spread = self._spread(rays, count)
        if spread is not None:
            bone *= spread[1]
        bone = self._into_table.seen_with(bone)
        bone *= self._diploe(rays.diploe_mm)
        if self.medium.speckle > 0.0:
            bone += (rays.grain @ self._speckle).view(self._number)
        bone = self._into_diploe.seen_with(bone)
        if spread is not None:
            bone *= spread[0]
        bone *= self._table(rays.table_mm)
        below = self._outer.far * bone
        np.subtract(1.0, below, out=below)
        passed = self._passed * rays.passage[:, None]
        passed *= bone
        bone = quotient(passed, below)
        bone += self._outer.near * self._front_loss * rays.front[:, None]
        if not rays.kept.all():
            bone = bone * rays.kept.astype(self._real)[:, None]
        line = self._line(rays.outer_mm - rays.gel_mm)  # <= 0: the line gives way
        pressed = bool((rays.gel_mm == self.film_mm).all())  # then all rays cross the same film
        gel = self._gel(rays.gel_mm[:1] if pressed else rays.gel_mm)
        return echo_bands(weights, line, gel, bone, self._face, count)
