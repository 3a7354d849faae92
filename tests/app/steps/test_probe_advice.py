"""Which probe is advised: only from sure echoes, in one sentence, with no figure without data."""

import re
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from rona_core.app.dependencies.staleness import input_digests
from rona_core.app.overview.acceptance import quality_rows
from rona_core.app.report.report import session_report
from rona_core.app.runtime.handling import handle
from rona_core.app.steps.acoustics.view import loss_words
from rona_core.app.steps.boundaries.ascan_view import FLAGS
from rona_core.app.steps.boundaries.probe_advice import probe_advice
from rona_core.app.steps.setup.messages import SetProbe
from rona_core.devices.probes import PROBE_DATA
from rona_core.geometry.arrays import readonly
from rona_core.session.document import Session
from rona_core.ultrasound.detection.bone_verdict import ENOUGH, judge_bone
from rona_core.ultrasound.detection.detect import (
    NO_FRONT,
    NO_INNER,
    OK,
    REMOVED,
    TILTED,
    TOO_THICK,
    TOO_THIN,
    UNSURE,
)

LIKE = (  # thickness and flag of the A-scans that surveys are mixed of
    (3.0, OK),
    (6.0, OK),
    (9.0, OK),
    (1.5, TOO_THIN),
    (15.0, TOO_THICK),
    (0.0, NO_INNER),
    (5.0, UNSURE),
    (5.0, TILTED),
    (0.0, NO_FRONT),
)


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
            "outer_ok": readonly(flags != NO_FRONT),
        },
        probe=probe,
    )


def mixed(shares, n=100):
    """Return thicknesses and flags of n A-scans, from shares by (thickness, flag)."""
    pairs = [pair for pair, share in shares.items() for _ in range(round(share * n))]
    return [mm for mm, _ in pairs], [flag for _, flag in pairs]


@pytest.mark.parametrize(
    ("probe", "shares", "kind", "advised", "words"),
    [
        ("2.25MHz", {(6.0, OK): 1.0}, "suits", "2.25MHz", "suits this bone of 6.0 to 6.0 mm"),
        ("1MHz", {(6.0, OK): 1.0}, "suits", "1MHz", "1 MHz probe suits"),
        ("2.25MHz", {(6.0, OK): 0.4, (5.0, TILTED): 0.6}, "suits", "2.25MHz", "suits"),
        ("2.25MHz", {(6.0, OK): 0.4, (5.0, REMOVED): 0.6}, "suits", "2.25MHz", "suits"),
        ("1MHz", {(6.0, OK): 0.7, (3.0, OK): 0.3}, "thin", "2.25MHz", "under 4 mm at 30 %"),
        ("1MHz", {(6.0, OK): 0.7, (0.0, TOO_THIN): 0.3}, "thin", "2.25MHz", "under 4 mm at 30 %"),
        ("1MHz", {(6.0, OK): 0.9, (3.0, OK): 0.1}, "suits", "1MHz", "suits"),
        ("1MHz", {(10.0, OK): 1.0}, "suits", "1MHz", "suits"),
        ("2.25MHz", {(6.0, OK): 0.6, (9.0, OK): 0.4}, "thick", "1MHz", "over 8 mm at 40 %"),
        ("2.25MHz", {(6.0, OK): 0.6, (0.0, TOO_THICK): 0.4}, "thick", "1MHz", "over 8 mm at 40 %"),
        ("2.25MHz", {(3.0, OK): 1.0}, "suits", "2.25MHz", "suits"),
        ("2.25MHz", {(6.0, OK): 0.4, (0.0, NO_INNER): 0.6}, "faint", None, "only 40 %"),
        ("1MHz", {(6.0, OK): 0.4, (0.0, NO_INNER): 0.6}, "faint", None, "with 2.25 MHz"),
        ("2.25MHz", {(6.0, OK): 0.6, (0.0, NO_INNER): 0.4}, "suits", "2.25MHz", "suits"),
        ("2.25MHz", {(3.0, OK): 0.5, (9.0, OK): 0.5}, "mixed", "2.25MHz", "no probe suits"),
        ("1MHz", {(3.0, OK): 0.5, (9.0, OK): 0.5}, "mixed", "1MHz", "no probe suits"),
        ("2.25MHz", {(1.5, TOO_THIN): 1.0}, "no echo", None, "sure at 0 of 100 places"),
        ("2.25MHz", {(0.0, NO_INNER): 1.0}, "no echo", None, "scan once with 1 MHz"),
        ("1MHz", {(0.0, NO_INNER): 1.0}, "no echo", None, "scan once with 2.25 MHz"),
        ("1MHz", {(0.0, NO_FRONT): 1.0}, "no front", None, "check gel"),
    ],
)
def test_the_probe_that_the_bone_wants_is_named_with_the_reason(
    demo, probe, shares, kind, advised, words
):
    verdict = judge_bone(found(demo, *mixed(shares), probe))
    assert (verdict.kind, verdict.advised) == (kind, advised)
    assert verdict.another == (advised not in (None, probe))
    assert words in verdict.sentence


def surveys():
    """Yield surveys of any three kinds of A-scans: few of them and many, in several shares."""
    for a, b, c in product(LIKE, repeat=3):
        for share, n in ((0.0, 90), (0.2, 90), (0.6, 15), (0.6, 300)):
            rest = 1.0 - share
            yield [a] * round(share * n) + [b] * round(0.6 * rest * n) + [c] * round(0.4 * rest * n)


@pytest.mark.parametrize("probe", ["2.25MHz", "1MHz"])
def test_no_survey_gets_advice_or_a_thickness_without_sure_echoes(demo, probe):
    """One verdict for each survey; what it claims is what its sure echoes measured."""
    other = "1MHz" if probe == "2.25MHz" else "2.25MHz"
    kinds = set()
    for pairs in surveys():
        mm, flags = (np.array(part) for part in zip(*pairs, strict=True))
        verdict = judge_bone(found(demo, mm, flags, probe))
        sure = mm[flags == OK]
        kinds.add(verdict.kind)
        said = [float(text) for text in re.findall(r"\d+\.\d\b", verdict.sentence)]
        if len(sure) < ENOUGH:
            assert verdict.kind in ("no front", "no echo")
            assert verdict.advised is None
            assert not said
            assert "suits" not in verdict.sentence
            assert "Better" not in verdict.sentence
        elif said:  # bounds of the thickness
            assert said == sorted(said)
            assert sure.min() - 0.05 <= said[0] <= said[1] <= sure.max() + 0.05
        if verdict.kind == "suits":
            judged = (flags != NO_FRONT) & (flags != TILTED)
            assert len(sure) >= 0.5 * judged.sum()
        else:  # another probe, or what else to do
            assert verdict.another or "Next: " in verdict.sentence
        assert verdict.another == ("Better: " in verdict.sentence)
        if verdict.another:
            assert verdict.advised == other
            assert PROBE_DATA[other].title in verdict.sentence
    assert kinds == {"no front", "no echo", "faint", "mixed", "suits"} | (
        {"thick"} if probe == "2.25MHz" else {"thin"}
    )


def with_detection(demo, detection):
    held = replace(demo.results.detection, value=detection)
    session = replace(demo, results=replace(demo.results, detection=held))
    maps = session.results.maps
    fresh = replace(maps, inputs=input_digests("maps", session, maps.message))
    return session.with_result("maps", fresh)


@pytest.mark.parametrize("flag", [NO_INNER, TOO_THIN, TOO_THICK, UNSURE])
def test_of_a_scan_without_a_sure_echo_all_places_say_the_same(demo, flag):
    """Report, acceptance and loss have one verdict; none claims that the bone is thin or lossy."""
    n = len(demo.captures.scan.scans)
    mute = found(demo, np.full(n, 1.5), np.full(n, flag), "2.25MHz")
    session = with_detection(demo, replace(mute, bone_loss=None))
    said = probe_advice(session).sentence
    (row,) = (
        row
        for row in quality_rows({"inner_coverage_fraction": 0.1}, session)
        if row.key == "inner_coverage_fraction"
    )
    assert row.stale_reason is None
    assert row.reason == said.rstrip(".")
    assert said in session_report(session, {}, None)
    for words in (loss_words(session.results.detection.value), FLAGS[flag], said):
        assert "bone takes" not in words
        assert "bone too" not in words
        assert "suits" not in words


def test_it_is_the_scan_of_the_session_that_counts(demo):
    assert probe_advice(Session()) is None
    assert not probe_advice(demo).another
    n = len(demo.captures.scan.scans)
    session = with_detection(demo, found(demo, *mixed({(9.0, OK): 1.0}, n=n), "2.25MHz"))
    assert "Choose it in step 1" in probe_advice(session).sentence
    chosen = handle(SetProbe(name="1MHz"), session)
    assert "It is chosen: scan again" in probe_advice(chosen).sentence
