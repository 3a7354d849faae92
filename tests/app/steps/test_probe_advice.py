"""Which probe is advised: by thickness, by what was not heard, and only where a scan tells."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rona_core.app.runtime.handling import handle
from rona_core.app.steps.boundaries.probe_advice import advised, probe_advice
from rona_core.app.steps.setup.messages import SetProbe
from rona_core.geometry.arrays import readonly
from rona_core.session.document import Session
from rona_core.session.files import load_session
from rona_core.ultrasound.detection.detect import NO_INNER, OK, TILTED, TOO_THICK, TOO_THIN

DEMO = Path(__file__).parents[3] / "sessions" / "demo.rona"


@pytest.fixture(scope="module")
def demo():
    return load_session(DEMO)


def found(demo, thickness_mm, flags, probe):
    """Return a detection with these thicknesses and flags (n,)."""
    n = len(flags)
    held = demo.results.detection.value
    whole = {
        name: readonly(np.resize(getattr(held, name), n))
        for name in held.__dataclass_fields__
        if isinstance(getattr(held, name), np.ndarray)
    }
    flags = np.asarray(flags)
    return replace(
        held,
        **{
            **whole,
            "thickness_mm": readonly(np.asarray(thickness_mm, dtype=np.float64)),
            "flag": readonly(flags),
            "inner_ok": readonly(flags == OK),
            "outer_ok": readonly(np.ones(n, dtype=np.bool_)),
        },
        probe=probe,
    )


def mixed(shares, n=100):
    """Return thicknesses and flags of n A-scans, from shares by (thickness, flag)."""
    pairs = [pair for pair, share in shares.items() for _ in range(round(share * n))]
    return [mm for mm, _ in pairs], [flag for _, flag in pairs]


@pytest.mark.parametrize(
    ("probe", "shares", "wanted", "words"),
    [
        ("2.25MHz", {(6.0, OK): 1.0}, "2.25MHz", "suits this bone of 6.0 to 6.0 mm"),
        ("1MHz", {(6.0, OK): 1.0}, "1MHz", "1 MHz probe suits"),
        ("1MHz", {(6.0, OK): 0.7, (3.0, OK): 0.3}, "2.25MHz", "under 4 mm at 30 %"),
        ("1MHz", {(6.0, OK): 0.7, (0.0, TOO_THIN): 0.3}, "2.25MHz", "under 4 mm at 30 %"),
        ("1MHz", {(6.0, OK): 0.9, (3.0, OK): 0.1}, "1MHz", "suits"),
        ("1MHz", {(10.0, OK): 1.0}, "1MHz", "suits"),
        ("2.25MHz", {(6.0, OK): 0.6, (9.0, OK): 0.4}, "1MHz", "over 8 mm at 40 %"),
        ("2.25MHz", {(6.0, OK): 0.6, (0.0, TOO_THICK): 0.4}, "1MHz", "over 8 mm at 40 %"),
        ("2.25MHz", {(3.0, OK): 1.0}, "2.25MHz", "suits"),
        ("2.25MHz", {(6.0, OK): 0.4, (0.0, NO_INNER): 0.6}, "1MHz", "No sure inner echo at 60 %"),
        ("2.25MHz", {(6.0, OK): 0.6, (0.0, NO_INNER): 0.4}, "2.25MHz", "suits"),
        ("2.25MHz", {(3.0, OK): 0.4, (0.0, NO_INNER): 0.6}, "2.25MHz", "suits"),
        ("2.25MHz", {(3.0, OK): 0.5, (9.0, OK): 0.5}, "2.25MHz", "neither probe suits"),
        ("1MHz", {(3.0, OK): 0.5, (9.0, OK): 0.5}, "1MHz", "neither probe suits"),
    ],
)
def test_the_probe_that_the_bone_wants_is_named_with_the_reason(demo, probe, shares, wanted, words):
    advice = advised(found(demo, *mixed(shares), probe))
    assert advice.advised == wanted
    assert advice.another == (wanted != probe)
    assert words in advice.sentence


def test_too_few_ascans_or_ascans_that_tell_no_thickness_say_nothing(demo):
    assert advised(found(demo, *mixed({(3.0, OK): 1.0}, n=19), "1MHz")) is None
    assert advised(found(demo, *mixed({(3.0, TILTED): 1.0}), "1MHz")) is None


def test_it_is_the_scan_of_the_session_that_counts(demo):
    assert probe_advice(Session()) is None
    assert not probe_advice(demo).another
    thick = replace(
        demo.results.detection,
        value=found(demo, *mixed({(9.0, OK): 1.0}, n=len(demo.captures.scan.scans)), "2.25MHz"),
    )
    session = replace(demo, results=replace(demo.results, detection=thick))
    assert "Choose it in step 1" in probe_advice(session).sentence
    chosen = handle(SetProbe(name="1MHz"), session)
    assert "It is chosen: scan again" in probe_advice(chosen).sentence
