"""Times of flight through a plate scatter as the bound of Cramer and Rao says, and no less."""

import numpy as np
import pytest

from benchmarks.reference.echo_timing import inner_bound
from rona_core.ultrasound.detection.detect import detect
from rona_core.ultrasound.detection.single.matched_filter import block_template
from rona_core.ultrasound.probe.probe_model import PROBES, ProbeSurvey
from rona_core.virtual.acoustics import echo_model
from tests.scenes.bone_scenes import plate

WRONG_MM = 1.0


@pytest.fixture
def narrow(monkeypatch):
    """The bound is that of an echo whose shape is known: detection does not know how it spreads."""
    monkeypatch.setattr(echo_model, "_spreading", lambda probe: None)


@pytest.mark.sweep(4)  # each value of each parameter twice
@pytest.mark.parametrize("excitation", ["pulse", "chirp"])
@pytest.mark.parametrize("name", list(PROBES))
@pytest.mark.parametrize("thickness_mm", [6.0, 8.0])
@pytest.mark.parametrize("snr_db", [20.0, 40.0])
@pytest.mark.usefixtures("narrow")
def test_on_a_plate_the_scatter_is_that_of_the_bound(name, excitation, thickness_mm, snr_db):
    scene = plate(thickness_mm, snr_db, name=name, excitation=excitation)
    # likewise the loss of the bone is given
    found = detect(
        ProbeSurvey(scene.track, scene.probe, excitation, positions_mm=scene.points_skull),
        bone_loss=1.0,
    )
    error_us = found.inner_us - found.outer_us - scene.bone_us
    pulse, sent = (block_template(scene.probe, kind) for kind in ("pulse", excitation))
    bound = inner_bound(pulse, scene.medium.table, thickness_mm, snr_db, sent).coherent_us
    assert np.abs(error_us).max() * found.sound_speed_mm_per_us / 2.0 < WRONG_MM
    assert 0.85 < error_us.std() / bound < 1.5


@pytest.mark.sweep(2)
@pytest.mark.parametrize("excitation", ["pulse", "chirp"])
@pytest.mark.parametrize("name", list(PROBES))
@pytest.mark.usefixtures("narrow")
def test_a_loss_that_is_learned_costs_micrometres_of_scatter(name, excitation):
    scene = plate(8.0, 40.0, name=name, excitation=excitation)
    found = detect(
        ProbeSurvey(scene.track, scene.probe, excitation, positions_mm=scene.points_skull)
    )
    error_us = found.inner_us - found.outer_us - scene.bone_us
    assert found.bone_loss is not None
    assert error_us.std() * found.sound_speed_mm_per_us / 2.0 < 0.006
    assert abs(error_us.mean()) * found.sound_speed_mm_per_us / 2.0 < 0.08


@pytest.mark.sweep(2)
@pytest.mark.parametrize("excitation", ["pulse", "chirp"])
@pytest.mark.parametrize("name", list(PROBES))
def test_a_beam_that_spreads_in_the_bone_brings_its_echo_forward(name, excitation):
    """On the axis the phase of a beam that spreads is ahead of a plane wave's (Gouy)."""
    scene = plate(8.0, 40.0, name=name, excitation=excitation)
    found = detect(
        ProbeSurvey(scene.track, scene.probe, excitation, positions_mm=scene.points_skull)
    )
    error_us = found.inner_us - found.outer_us - scene.bone_us
    assert found.inner_ok.all()
    assert -0.08 < error_us.mean() * found.sound_speed_mm_per_us / 2.0 < -0.02
    assert error_us.std() * found.sound_speed_mm_per_us / 2.0 < 0.006
