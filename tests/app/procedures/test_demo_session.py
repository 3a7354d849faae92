"""The demo session that ships: complete, and computed by this program, not by an older one."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.judge import step_states
from rona_core.app.messages.message import message_from
from rona_core.app.runtime.session_step import recompute, replay
from rona_core.errors import CancelledError
from rona_core.session.codec import digest
from rona_core.session.files import load_session, session_bytes, session_from_bytes
from tests.helpers.derived import derived
from tests.helpers.result_differences import assert_alike, compare

DEMO = Path(__file__).parents[3] / "sessions" / "demo.rona"
REMEDY = "make it anew: make demo-session"
# Which samples of the milling motion are left out flips, too: layers ended 5e-5 later, joints were
# 0.006 rad apart at the same time, the largest acceleration between samples 3 %.
CLOSE_OF_MILLING = (1e-4, 0.01, 0.05)


@pytest.fixture(scope="module")
def session():
    return load_session(DEMO)


def test_all_steps_of_the_demo_session_are_done(session):
    assert [state.state for state in step_states(session)] == ["done"] * 10


@pytest.mark.parametrize(
    "processor",
    [
        pytest.param("Haswell", marks=pytest.mark.ci),
        pytest.param("Nehalem", marks=pytest.mark.slow),
    ],
)
def test_nothing_is_stale_where_another_processor_opens_the_session(processor):
    """BLAS has kernels of its own for each processor, which round the last bits differently."""
    ended = subprocess.run(
        [sys.executable, "-m", "rona_ui", "inspect", str(DEMO)],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "OPENBLAS_CORETYPE": processor},
    )
    assert ended.stdout.count(" done ") == 10, ended.stdout


@pytest.fixture(scope="module")
def packed(session):
    return session_bytes(session)


@pytest.mark.slow
def test_the_demo_session_packs_close_to_the_noise_that_it_holds(session, packed):
    """12.4 MB, most of it A-scans, and most of that their noise; the rest poses, joints, plans."""
    assert len(packed) < 13e6
    assert session_bytes(session_from_bytes(packed)) == packed


@pytest.mark.slow
@pytest.mark.parametrize("name", ["detection", "second_detection"])
def test_a_packed_file_gives_the_very_same_detection(session, packed, name):
    back = session_from_bytes(packed)
    assert digest(back) == digest(session)
    stored = getattr(session.results, name)
    message = message_from(stored.message, dict(stored.arguments))
    again, before = (derived(name, s, message) for s in (back, session))
    assert digest(again) == digest(before)


def test_a_replay_tells_how_far_it_is_and_heeds_cancel(session):
    shares = []
    with pytest.raises(CancelledError):
        replay(session, shares.append, lambda: len(shares) >= 3)
    assert 0.0 < shares[-1] < 1.0
    assert shares == sorted(shares)


def even(plan):
    """What a milling plan says without the numbers of its samples: its joints at even times."""
    motion, checks = plan.trajectory, plan.certificate.checks
    times = np.linspace(0.0, motion.times_s[-1], 3000)
    joints = np.array([np.interp(times, motion.times_s, q) for q in motion.qs_rad.T])
    exact = plan.verdicts, plan.chosen, motion.duration_s, plan.layer_ends_s, plan.changes_s
    return exact, joints, tuple((check.name, check.holds, check.value) for check in checks)


@pytest.mark.slow
def test_every_result_of_the_demo_session_recomputes(session):
    fresh = recompute(session).results
    names = [name for name in REGISTRY.replayed if fresh.get(name) is not None]
    assert len(names) == 16
    plans = [even(results.get("milling").value) for results in (session.results, fresh)]
    for before, again, close in zip(*plans, CLOSE_OF_MILLING, strict=True):
        apart = compare(before, again)
        assert apart.largest <= close, f"milling differs at {apart.where}: {REMEDY}"
        assert apart.n_discrete == 0, f"milling: {REMEDY}"
    for name in names:
        if name == "milling":
            continue
        before, again = (results.get(name).value for results in (session.results, fresh))
        assert_alike(before, again, name, REMEDY)
