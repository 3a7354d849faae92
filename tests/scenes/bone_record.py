"""One set of A-scans of known bone: the record of the virtual probe, and the truth beside it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rona_core.devices.samples import AScan, AScanTrack
from rona_core.devices.settings import ProbeSettings
from rona_core.geometry.arrays import Floats, Ints
from rona_core.geometry.pose import Pose, Poses
from rona_core.ultrasound.probe.probe_model import FULL_SCALE_SHARE, ProbeModel, probe_model
from rona_core.virtual.acoustics.medium import Medium
from rona_core.virtual.acoustics.microstructure import local_speed_factors
from rona_core.virtual.acoustics.probe import Layered, VirtualProbe
from rona_core.virtual.clock import CaptureClock
from tests.scenes.bone_shapes import angles_deg, axes_of

PERIOD_S = 0.05
BEHIND_MM = 10.0  # rays start this far before the face
STEP_MM = 1e-3  # between the rays that show the tilt of a boundary


@dataclass(frozen=True, slots=True, eq=False)
class BoneScene:
    """A-scans (n,) with the truth along the probe's axis; places are in ``skull``, mm."""

    name: str
    track: AScanTrack
    probe: ProbeModel
    settings: ProbeSettings
    Ts_skull_probe: Poses
    cells: Ints  # (n, 2) row and column of the scan grid
    pitch_mm: float  # of that grid
    outer_mm: Floats  # (n,) face of the uncompressed line to the outer boundary
    thickness_mm: Floats  # (n,)
    bone_us: Floats  # (n,) there and back through the bone, at the speeds of 1.5 MHz
    outer_tilt_deg: Floats  # (n,) of the outer boundary against perpendicular
    inner_tilt_deg: Floats  # (n,) and of the inner one
    inner_snr_db: float | None  # inner echo of a pulse over in-band rms, where it was asked for
    medium: Medium  # what the bone is made of

    def __len__(self) -> int:
        return len(self.track)

    @property
    def points_skull(self) -> Floats:
        """Where the axis enters the bone (n, 3)."""
        axes = axes_of(self.Ts_skull_probe)
        return self.Ts_skull_probe.translations + self.outer_mm[:, None] * axes

    @property
    def speed_mm_per_us(self) -> Floats:
        """The true mean speed along the axis (n,)."""
        return 2.0 * self.thickness_mm / self.bone_us


def record(
    name: str,
    bone: Layered,
    medium: Medium,
    settings: ProbeSettings,
    poses: Sequence[Pose],
    cells: Ints,
    pitch_mm: float,
    seed: int,
    inner_snr_db: float | None = None,
) -> BoneScene:
    """Return the A-scans that the virtual probe takes at these poses, with the truth."""
    clock, here = CaptureClock(), [poses[0]]
    probe = VirtualProbe(clock, lambda times: here[0].repeated(len(times)), bone, medium)
    probe.begin(settings, seed, 0)
    scans: list[AScan] = []
    for number, pose in enumerate(poses):
        here[0] = pose
        clock.wait_until(PERIOD_S * (number + 1))
        scans.append(probe.acquire())
    Ts_skull_probe = Poses.stack(poses)
    found = _along(bone, Ts_skull_probe, (0.0, 0.0))
    table, diploe, inner = np.diff(found, axis=1).T
    points = Ts_skull_probe.translations + found[:, :1] * axes_of(Ts_skull_probe)
    local = local_speed_factors(points, seed, medium.local_speed_sd)
    slow = 1.0 / medium.table.speed_mm_per_us, 1.0 / medium.diploe.speed_mm_per_us
    outer_tilt, inner_tilt = _tilts_deg(bone, Ts_skull_probe)
    return BoneScene(
        name=name,
        track=AScanTrack.from_scans(scans),
        probe=probe_model(settings),
        settings=settings,
        Ts_skull_probe=Ts_skull_probe,
        cells=cells,
        pitch_mm=pitch_mm,
        outer_mm=found[:, 0],
        thickness_mm=found[:, 3] - found[:, 0],
        bone_us=2.0 * ((table + inner) * slow[0] + diploe * slow[1]) / local,
        outer_tilt_deg=outer_tilt,
        inner_tilt_deg=inner_tilt,
        inner_snr_db=inner_snr_db,
        medium=medium,
    )


def inner_level_db(
    bone: Layered, medium: Medium, settings: ProbeSettings, T_skull_probe: Pose
) -> float:
    """Return the peak of the inner echo over that of a front echo in perfect contact."""
    rf: list[Floats] = []
    for behind in (medium.brain, medium.table):
        probe = VirtualProbe(
            CaptureClock(),
            lambda times: T_skull_probe.repeated(len(times)),
            bone,
            replace(medium, brain=behind),
        )
        probe.begin(settings, 0, 0)  # without noise to speak of, and the same in both
        rf.append(probe.acquire().rf)
    return float(20.0 * np.log10(np.abs(rf[0] - rf[1]).max() / FULL_SCALE_SHARE))


def _along(bone: Layered, Ts_skull_probe: Poses, aside_mm: tuple[float, float]) -> Floats:
    """Return depths (n, 4) below the face along lines parallel to the axis."""
    axes = axes_of(Ts_skull_probe)
    starts = Ts_skull_probe.translations - BEHIND_MM * axes
    starts = starts + Ts_skull_probe.rotations[:, :, :2] @ np.array(aside_mm)
    return bone.layers(starts, axes) - BEHIND_MM


def _tilts_deg(bone: Layered, Ts_skull_probe: Poses) -> tuple[Floats, Floats]:
    """Return the angles (n,) of outer and inner boundary against perpendicular to the axis."""
    x = _along(bone, Ts_skull_probe, (STEP_MM, 0.0)) - _along(bone, Ts_skull_probe, (-STEP_MM, 0.0))
    y = _along(bone, Ts_skull_probe, (0.0, STEP_MM)) - _along(bone, Ts_skull_probe, (0.0, -STEP_MM))
    steep = np.hypot(x, y) / (2.0 * STEP_MM)
    up = np.zeros((len(steep), 3)) + (0.0, 0.0, 1.0)
    normals = [np.column_stack((s, 0.0 * s, np.ones(len(s)))) for s in (steep[:, 0], steep[:, 3])]
    outer, inner = (angles_deg(up, n / np.linalg.norm(n, axis=1)[:, None]) for n in normals)
    return outer, inner
