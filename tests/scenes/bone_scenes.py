"""A-scans of bone with known boundaries: plates, near-parallel bone, hard bone, simulated skulls.

Every scene has two splits: one with nominal materials, and one with materials, texture, pulses and
shapes drawn at random. Of the second, each seed is another world: detection is tuned with some
(``TRIAL_SEEDS``) and judged by one that nothing else has seen (``TEST_SEED``).
"""

from dataclasses import replace

import numpy as np

from rona_core.devices.settings import Excitation, ProbeSettings, PulseShape
from rona_core.geometry.arrays import Floats, Ints
from rona_core.geometry.pose import Pose
from rona_core.ultrasound.probe.materials import Material
from rona_core.virtual.acoustics.medium import MEDIA, Medium
from rona_core.virtual.specimen.simulated.simulated_skull import SimulatedSpecimen
from tests.scenes.bone_record import BoneScene, inner_level_db, record
from tests.scenes.bone_shapes import Dome, grid_places, leans_rad

NOMINAL_SEED, TEST_SEED = 1_000, 35_170_000  # no test and no tuning uses the second
TRIAL_SEEDS = 200_000, 300_000, 400_000  # drawn as for the test, but to tune with and look at
ABOVE_MM = 20.0  # rays onto a skull start this far outside
SMOOTH = Medium(ramp_mm=0.5, outer_roughness_mm=0.0, inner_roughness_mm=0.0, speckle=0.0)
DRAWN: tuple[PulseShape, ...] = ("damped", "double", "ringing")  # none of them the nominal one
LOCAL_SPEED_SD = 0.02


def plate(
    thickness_mm: float = 6.0,
    inner_snr_db: float = 20.0,
    *,
    name: str = "2.25MHz",
    excitation: Excitation = "pulse",
    lean_deg: float = 0.0,
    wedge_deg: float = 0.0,
    layered: bool = False,
    n: int = 150,
    nominal: bool = True,
    drawn_seed: int = TEST_SEED,
) -> BoneScene:
    """Return shots at a flat plate of bone without texture, where only noise is in the way.

    The noise is set by the inner echo of a pulse: its peak over the rms of the noise in the probe's
    -6 dB band. A chirp is sent with the same noise. ``layered``: with a diploe inside.
    """
    seed, random = _random(0, nominal, drawn_seed)
    medium = _medium(SMOOTH, random, nominal)
    medium = medium if layered else replace(medium, diploe=medium.table, ramp_mm=0.0)
    gentle = 0.3 / n  # so that no two shots have quite the same lag
    bone = Dome(thickness_mm, slopes=(gentle, float(np.tan(np.deg2rad(wedge_deg)))))
    leans = leans_rad(random, n, lean_deg, lean_deg)
    lifts = random.uniform(-0.5, 0.5, n)
    poses = [
        bone.pose((float(i - n // 2), 0.0), float(lifts[i]), (leans[i, 0], leans[i, 1]))
        for i in range(n)
    ]
    settings = _settings(name, "pulse", 90.0, random, nominal)
    front_snr = inner_snr_db - inner_level_db(bone, medium, settings, poses[n // 2])
    settings = replace(settings, excitation=excitation, front_snr_db=min(front_snr, 90.0))
    cells = np.column_stack((np.zeros(n, dtype=np.int64), np.arange(n)))
    label = f"plate {thickness_mm:g} mm, {name} {excitation}, inner {inner_snr_db:g} dB"
    return record(label, bone, medium, settings, poses, cells, 1.0, seed, inner_snr_db)


def parallel_bone(
    thickness_mm: float,
    *,
    name: str = "2.25MHz",
    excitation: Excitation = "pulse",
    front_snr_db: float = 50.0,
    most_lean_deg: float = 2.0,
    side: int = 7,
    patches: int = 2,
    nominal: bool = True,
    drawn_seed: int = TEST_SEED,
) -> list[BoneScene]:
    """Return patches of the skull suite: near-parallel inner table, probe up to 2 degrees off."""
    scenes: list[BoneScene] = []
    for patch in range(patches):
        seed, random = _random(1 + round(100 * thickness_mm) * 10 + patch, nominal, drawn_seed)
        bone = _dome(random, thickness_mm, nominal).with_relief(random, np.deg2rad(0.7), 30.0)
        leans = leans_rad(random, side * side, 0.0, most_lean_deg)
        settings = _settings(name, excitation, front_snr_db, random, nominal)
        label = f"skull {thickness_mm:g} mm, {name} {excitation}, patch {patch}"
        medium = _medium(Medium(), random, nominal)
        scenes.append(_patch(label, bone, medium, settings, leans, side, random, seed))
    return scenes


def hard_bone(
    thickness_mm: float = 6.0,
    *,
    name: str = "2.25MHz",
    excitation: Excitation = "pulse",
    front_snr_db: float = 50.0,
    side: int = 16,
    nominal: bool = True,
    drawn_seed: int = TEST_SEED,
) -> BoneScene:
    """Return a grid of the hard suite: 2.5 times the scatter, sharp diploe, tilted here and there.

    15 % of the scans lean by 2 to 4 degrees, the others by up to 1; the inner table is tilted by
    2.5 degrees rms against the outer one.
    """
    seed, random = _random(50_000 + round(100 * thickness_mm), nominal, drawn_seed)
    bone = _dome(random, thickness_mm, nominal).with_relief(random, np.deg2rad(2.5), 30.0)
    tilted = random.uniform(size=side * side) < 0.15
    leans = leans_rad(random, side * side, 0.0, 1.0)
    leans[tilted] = leans_rad(random, int(tilted.sum()), 2.0, 4.0)
    settings = _settings(name, excitation, front_snr_db, random, nominal)
    medium = _medium(MEDIA["hard"], random, nominal)
    label = f"hard {thickness_mm:g} mm, {name} {excitation}"
    return _patch(label, bone, medium, settings, leans, side, random, seed)


def anatomical_bone(
    patient: int = 0,
    *,
    name: str = "2.25MHz",
    excitation: Excitation = "chirp",
    front_snr_db: float = 50.0,
    radius_mm: float = 20.0,
    pitch_mm: float = 1.0,
    lines_mm: float = 2.0,
    tilt_sd_deg: float = 1.0,
    nominal: bool = True,
    drawn_seed: int = TEST_SEED,
) -> BoneScene:
    """Return a meander over the region of a simulated skull as it is, inner table and all."""
    seed, random = _random(80_000 + patient, nominal, drawn_seed)
    specimen = SimulatedSpecimen(seed % 2**31)
    poses, cells = standing_meander(
        specimen,
        random,
        radius_mm=radius_mm,
        pitch_mm=pitch_mm,
        lines_mm=lines_mm,
        tilt_sd_deg=tilt_sd_deg,
    )
    settings = _settings(name, excitation, front_snr_db, random, nominal)
    settings = replace(settings, pitch_mm=pitch_mm)
    medium = _medium(Medium(), random, nominal)
    label = f"anatomical, patient {patient}, {name} {excitation}"
    return record(label, specimen, medium, settings, poses, cells, pitch_mm, seed)


def standing_meander(
    specimen: SimulatedSpecimen,
    random: np.random.Generator,
    *,
    radius_mm: float = 20.0,
    pitch_mm: float = 1.0,
    lines_mm: float = 2.0,
    tilt_sd_deg: float = 1.0,
) -> tuple[list[Pose], Ints]:
    """Return poses of a probe in ``skull`` on a meander over the region, and their cells (n, 2).

    The probe stands on the bone, off the normal and off the ground as a robot would be.
    """
    center, normal = specimen.region.center_skull, specimen.region.normal_skull
    across = np.linalg.svd(normal[None])[2][1:]
    rows = np.arange(-radius_mm, radius_mm + 1e-9, lines_mm)
    columns = np.arange(-radius_mm, radius_mm + 1e-9, pitch_mm)
    order = [
        (i, j if i % 2 == 0 else len(columns) - 1 - j)
        for i in range(len(rows))
        for j in range(len(columns))
    ]
    cells = np.array([c for c in order if np.hypot(rows[c[0]], columns[c[1]]) <= radius_mm])
    plane = np.stack((columns[cells[:, 1]], rows[cells[:, 0]]), axis=1)
    above = center + plane @ across + ABOVE_MM * normal
    down = np.broadcast_to(-normal, above.shape)
    points = above + specimen.ray(above, down)[:, None] * down
    axes = -specimen.normal(points)
    lean = random.normal(0.0, np.deg2rad(tilt_sd_deg) / np.sqrt(2.0), (len(points), 2))
    lift = random.normal(0.0, 0.3, len(points))
    poses = [
        _standing(point, axis, across[0]) @ Pose.from_rotvec((a, b, 0.0), (0.0, 0.0, -up))
        for point, axis, (a, b), up in zip(points, axes, lean, lift, strict=True)
    ]
    return poses, cells


def _random(place: int, nominal: bool, drawn_seed: int) -> tuple[int, np.random.Generator]:
    seed = (NOMINAL_SEED if nominal else drawn_seed) + place
    return seed, np.random.default_rng((seed, 0xB04E))


def _settings(
    name: str,
    excitation: Excitation,
    front_snr_db: float,
    random: np.random.Generator,
    nominal: bool,
) -> ProbeSettings:
    """Return the probe: one whose pulse has a shape that was drawn, if anything is.

    A reference block shows that pulse, so detection may know it: ``probe_model(settings)``.
    """
    shape = None if nominal else DRAWN[int(random.integers(len(DRAWN)))]
    return ProbeSettings(
        name=name, excitation=excitation, front_snr_db=front_snr_db, shots=1, pulse_shape=shape
    )


def _dome(random: np.random.Generator, thickness_mm: float, nominal: bool) -> Dome:
    if nominal:
        return Dome(thickness_mm, 80.0)
    first = random.uniform(0.24, 0.34)
    return Dome(
        thickness_mm, random.uniform(60.0, 110.0), (0.0, 0.0), (first, random.uniform(0.64, 0.76))
    )


def _medium(base: Medium, random: np.random.Generator, nominal: bool) -> Medium:
    """Return the nominal medium, or one whose every property was drawn anew."""
    if nominal:
        return base
    table = _drawn(base.table, random)
    diploe = table if base.diploe == base.table else _drawn(base.diploe, random)
    scale = random.uniform(0.6, 1.5, 4)
    return replace(
        base,
        table=table,
        diploe=diploe,
        brain=_drawn(base.brain, random, 0.01),
        ramp_mm=base.ramp_mm * scale[0],
        outer_roughness_mm=base.outer_roughness_mm * scale[1],
        inner_roughness_mm=base.inner_roughness_mm * scale[2],
        speckle=base.speckle * min(scale[3], 1.25),
        local_speed_sd=0.0 if base is SMOOTH else LOCAL_SPEED_SD,
    )


def _drawn(material: Material, random: np.random.Generator, sd: float = 0.03) -> Material:
    return Material(
        material.speed_mm_per_us * (1.0 + sd * float(np.clip(random.normal(), -2.0, 2.0))),
        material.density_g_per_cm3 * (1.0 + 0.5 * sd * float(np.clip(random.normal(), -2.0, 2.0))),
        material.attenuation_db_per_cm * random.uniform(0.75, 1.3),
        random.uniform(1.0, 1.15),
    )


def _patch(
    label: str,
    bone: Dome,
    medium: Medium,
    settings: ProbeSettings,
    leans: Floats,
    side: int,
    random: np.random.Generator,
    seed: int,
    pitch_mm: float = 2.0,
) -> BoneScene:
    places, cells = grid_places(side, pitch_mm)
    lifts = random.normal(0.0, 0.3, len(places))
    poses = [
        bone.pose((x, y), float(up), (a, b))
        for (x, y), up, (a, b) in zip(places, lifts, leans, strict=True)
    ]
    return record(label, bone, medium, settings, poses, cells, pitch_mm, seed)


def _standing(point: Floats, axis: Floats, towards: Floats) -> Pose:
    x = towards - (towards @ axis) * axis
    x = x / np.linalg.norm(x)
    return Pose(np.column_stack((x, np.cross(axis, x), axis)), point)
