"""The gauge plate in a session: recorded before a scan, used by the maps, stale with the probe."""

import numpy as np
import pytest

from rona_core.app.dependencies.judge import judge_part
from rona_core.app.dependencies.staleness import required, stale_reason
from rona_core.app.procedure import run_procedure, stages
from rona_core.app.steps.acoustics.derivation import HELD_PROBE, ROBOT_PROBE
from rona_core.app.steps.maps.messages import StartMapping
from rona_core.app.steps.path.messages import StartPathCapture
from rona_core.app.steps.pointer.messages import StartPointerCapture
from rona_core.app.steps.roll.messages import StartRollSearch
from rona_core.app.steps.scan.derivation import KNOWN_MOUNTING, POSES
from rona_core.app.steps.scan.messages import (
    CalibrateProbeMounting,
    StartProbeMountingCapture,
)
from rona_core.app.steps.scan.step import mounting_words
from rona_core.app.steps.setup.messages import SetProbe, SetRegion, SetWorld
from rona_core.app.steps.surface.messages import StartSurfaceCapture
from rona_core.app.steps.tool.messages import StartToolCapture
from rona_core.compose import new_session, new_workbench, world_of
from tests.helpers.session_file import reopened

SMALL = stages(
    "detection",
    StartToolCapture(n_pivot=12, n_translate=4),
    StartPointerCapture(duration_s=6.0),
    StartSurfaceCapture(duration_s=20.0),
    StartPathCapture(duration_s=12.0, spacing_mm=5.0),
    StartRollSearch(n_rolls=24),
    skip=("gauge",),
)


@pytest.fixture(scope="module")
def scanned():
    """A small region, mapped with a warm line and a probe that is clamped off its place."""
    bench = new_session("warm", seed=7)
    bench.dispatch(SetRegion(radius_mm=12.0))
    bench.dispatch(SetWorld(line_excess_k=10.0, mounting_mm=0.6))
    assert run_procedure(bench, SMALL).completed
    yield bench
    bench.close()


@pytest.mark.ci
def test_the_gauge_takes_away_what_mounting_and_warm_line_do_to_the_map(scanned):
    bench = new_workbench(scanned.session)
    before = bench.figures()
    poses = POSES.read(bench.session)
    assert mounting_words(bench.session) == ""
    bench.run(StartProbeMountingCapture(n=5))
    assert stale_reason("maps", bench.session) is not None  # they do not know of it yet
    bench.run(StartMapping())
    after = bench.figures()
    assert after["outer_same_robot_rms_mm"] < 0.08 < before["outer_same_robot_rms_mm"]
    found = KNOWN_MOUNTING.read(bench.session)
    moved = POSES.read(bench.session).translations - poses.translations
    axes = poses.rotations[:, :, 2]
    np.testing.assert_allclose(moved, found.offset_mm * axes, atol=1e-9)
    true_mm = world_of(bench.session.setup).clamping.translation[2]
    assert abs(found.offset_mm - true_mm) < 0.4
    assert required(ROBOT_PROBE, bench.session).line_delay_us == pytest.approx(found.line_delay_us)
    assert required(HELD_PROBE, bench.session).line_delay_us == pytest.approx(
        18.75
    )  # of another probe
    assert judge_part("mounting", bench.session).state == "usable"
    outer = [s.results.maps.value.outer_points_base for s in (scanned.session, bench.session)]
    outward = -POSES.read(bench.session).rotations[:, :, 2]
    shift_mm = np.median(np.einsum("ij,ij->i", outer[1] - outer[0], outward))
    assert float(mounting_words(bench.session).split()[2]) == pytest.approx(shift_mm, abs=0.02)
    saved = reopened(bench.session)
    assert stale_reason("maps", saved) is None
    assert KNOWN_MOUNTING.read(saved).offset_mm == found.offset_mm
    bench.close()


@pytest.mark.slow
def test_it_is_stale_with_the_probe_and_forgotten_on_demand(scanned):
    bench = new_workbench(scanned.session)
    bench.run(StartProbeMountingCapture(n=5))
    bench.run(StartMapping())
    bench.dispatch(SetProbe(excitation="pulse"))
    assert KNOWN_MOUNTING.read(bench.session) is None
    assert judge_part("mounting", bench.session).state == "stale"
    bench.dispatch(SetProbe())
    assert KNOWN_MOUNTING.read(bench.session) is not None
    assert stale_reason("maps", bench.session) is None
    bench.dispatch(CalibrateProbeMounting(use=False))
    assert mounting_words(bench.session) == ""
    assert stale_reason("maps", bench.session) is not None
    bench.close()
