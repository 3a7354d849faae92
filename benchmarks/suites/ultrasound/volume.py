"""The echo volume: thickness read from it beside the inner map, in each mode, and what it costs.

The demo session, and the whole procedure over seeds (``--seeds 8`` takes so many). A mode that is
not offered stands beside the one that is: share of the columns of both maps in which a ridge is
sure, and how far 95 % of those are from the inner map.
"""

import tracemalloc
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.metric import Metric, Progress, cpu_ms, over_seeds
from benchmarks.reference.volume_modes import compounded, filled
from benchmarks.suites.honesty.design import session_of
from rona_core.app.dependencies.staleness import required
from rona_core.app.steps.maps.inputs import MAPS
from rona_core.app.steps.maps.volume import echo_volume, scan_lines
from rona_core.geometry.pose import Pose
from rona_core.mapping.boundary_map import BoundaryMap
from rona_core.mapping.volume.echo_volume import EchoVolume
from rona_core.mapping.volume.inner_ridge import RidgeAgreement, ridge_agreement
from rona_core.mapping.volume.reconstruction import ScanLines, VolumeSettings, reconstruct_volume
from rona_core.session.document import Session
from rona_core.session.files import load_session
from rona_core.ultrasound.probe.probe_model import probe_model

SEEDS = range(301, 304)
FILES: tuple[Path, ...] = (Path(__file__).resolve().parents[3] / "sessions" / "demo.rona",)
WIDTH_MM, RADIUS_MM, ROWS_MM = 60.0, 80.0, 3.0  # of the region whose cost is told
FILL_MM = VolumeSettings().fill_radius_mm


def run(progress: Progress) -> list[Metric]:
    """Return agreement of each mode over all sessions, and time and memory of a large region."""
    found: dict[str, list[RidgeAgreement | None]] = {}
    lines: ScanLines | None = None
    for session in sessions(progress):
        lines = scan_lines(session)
        maps = required(MAPS, session)
        for name, volume in modes(echo_volume(session), lines):
            found.setdefault(name, []).append(ridge_agreement(volume, maps))
    metrics = [metric for name, parts in found.items() for metric in figures(name, parts)]
    return metrics if lines is None else [*metrics, *cost(lines)]


def sessions(progress: Progress) -> Iterator[Session]:
    """Yield the session of every file and of every seed."""
    for path in FILES:
        progress(path.name)
        yield load_session(path)
    for seed in SEEDS:
        progress(f"seed {seed}")
        yield session_of(seed)


def modes(volume: EchoVolume, lines: ScanLines) -> Iterator[tuple[str, EchoVolume]]:
    """Yield the volume as it is offered, and as other modes make it."""
    yield "linear, mean", volume
    bare = compounded(volume, lines, "linear", "mean")
    yield "no holes filled", bare
    yield "holes filled at one height", filled(bare, FILL_MM, level=True)
    for name, one in (
        ("nearest, mean", compounded(volume, lines, "nearest", "mean")),
        ("linear, maximum", compounded(volume, lines, "linear", "maximum")),
        ("linear, latest", compounded(volume, lines, "linear", "latest")),
    ):
        yield name, filled(one, FILL_MM)


def figures(name: str, parts: list[RidgeAgreement | None]) -> list[Metric]:
    """Return share and distance of one mode; goals are for the one that is offered."""
    offered = name == "linear, mean"
    share = [None if part is None else part.share for part in parts]
    apart = [None if part is None else part.p95_abs_mm for part in parts]
    median = [None if part is None else part.median_abs_mm for part in parts]
    goals = (0.5, 0.15, 0.5) if offered else (None, None, None)
    return [
        *over_seeds(f"{name}: sure columns", share, "share", "higher", goal=goals[0]),
        *over_seeds(f"{name}: half within", median, "mm", "lower", goal=goals[1]),
        *over_seeds(f"{name}: 95 % within", apart, "mm", "lower", goal=goals[2]),
    ]


def cost(lines: ScanLines) -> list[Metric]:
    """Return time and memory of a volume of 60 x 60 mm at 1 mm cells; profiles are given."""
    probe = probe_model("2.25MHz")
    wide, outer = wide_region(lines)

    def make() -> EchoVolume:
        return reconstruct_volume(wide, outer, probe)

    ms = cpu_ms(make)
    tracemalloc.start()
    volume = make()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    held = volume.amplitude.nbytes + volume.measured.nbytes + volume.filled.nbytes
    name = f"{WIDTH_MM:.0f} x {WIDTH_MM:.0f} mm, {len(wide.speeds_mm_per_us)} A-scans"
    return [
        Metric(f"{name}: CPU time", ms, "ms", "lower"),
        Metric(f"{name}: peak memory", peak / 1e6, "MB", "lower", 200.0),
        Metric(f"{name}: volume", held / 1e6, "MB", "lower"),
    ]


def wide_region(lines: ScanLines) -> tuple[ScanLines, BoundaryMap]:
    """Return A-scans in rows over a dome, with the profiles of others, and the map of the dome."""
    half = WIDTH_MM / 2
    axis = np.arange(-half, half + 1e-9, 1.0)
    rows = np.arange(-half, half + 1e-9, ROWS_MM)
    u, v = (part.ravel() for part in np.meshgrid(axis, rows, indexing="ij"))
    points = np.column_stack((u, v, np.sqrt(RADIUS_MM**2 - u**2 - v**2) - RADIUS_MM))
    centre = np.array((0.0, 0.0, -RADIUS_MM))
    axes = (centre - points) / np.linalg.norm(centre - points, axis=1, keepdims=True)
    some = np.resize(np.arange(len(lines.profiles)), len(points))
    grid = np.add.outer(axis**2, axis**2)
    heights = np.sqrt(RADIUS_MM**2 - grid) - RADIUS_MM
    outer = BoundaryMap(Pose.identity(), axis, axis, heights, np.ones(grid.shape, dtype=np.bool_))
    held = replace(lines.profiles, level=lines.profiles.level[some])
    return ScanLines(points, axes, lines.speeds_mm_per_us[some], held), outer
