"""Random parts of real plate records: the same answer as of the whole, or a flag.

The windows are those of ``tests.scenes.real_plates``. A line is wrong that is off the median of the
whole record by a quarter of a cycle and not flagged.
"""

import numpy as np

from benchmarks.metric import Metric, Progress
from rona_core.devices.files.rf.rf_data import RecordedRf
from rona_core.errors import RonaError
from rona_core.geometry.arrays import Bools, Floats
from rona_core.ultrasound.recorded.band import Band, analytic, near_one
from rona_core.ultrasound.recorded.plate_detector import detect_recorded
from tests.scenes.real_plates import CENTRE_MHZ, PLATES, folder, read, window

WINDOWS, SEED = 200, 70_000  # others than those the detection was adjusted with
WRONG_SHARE, FLAGGED_SHARE = 0.005, 0.15
FRONT_SHARE = 0.25  # of the loudest moment: the front of the plain method
STRAY_MM = 0.5  # off the median, at which the plain method flags


def detected(record: RecordedRf, speed: float) -> tuple[Floats, Bools, Floats]:
    """Return thickness (n,), which are not flagged (n,), and sigma (n,) by the product."""
    try:
        found = detect_recorded(record, speed)
    except RonaError:
        nothing = np.zeros(len(record))
        return nothing, nothing > 0, nothing
    return found.thickness_mm, found.ok, found.sigma_mm


def plain(record: RecordedRf, speed: float) -> tuple[Floats, Bools, Floats]:
    """Return the same by plain correlation: each front against the rest of its own line.

    The front is the first moment above a quarter of the loudest; the largest envelope of the
    correlation behind it is the back wall; lines off the median are flagged. The band is given.
    """
    rate = record.sampling_mhz
    z = analytic(near_one(record.rf), rate, Band(CENTRE_MHZ, 0.7 * CENTRE_MHZ))
    envelope = np.abs(z)
    front = np.argmax(envelope > FRONT_SHARE * envelope.max(axis=1)[:, None], axis=1)
    before, after = round(0.7 * rate), round(1.5 * rate)
    thickness = np.zeros(len(z))
    for row, at in enumerate(front):
        pulse = z[row, max(0, at - before) : at + after]
        rest = z[row, at + 2 * after :]
        if len(rest) > len(pulse):
            like = np.abs(np.correlate(rest, pulse, "valid"))
            lag = int(np.argmax(like)) + 2 * after + min(before, at)
            thickness[row] = lag / rate * speed / 2.0
    ok = np.abs(thickness - np.median(thickness)) < STRAY_MM
    return thickness, ok, np.full(len(z), 0.5 / CENTRE_MHZ * speed / 2.0)


def run_windows(progress: Progress) -> list[Metric]:
    """Return wrong and flagged lines over all windows of the real records; none without them."""
    if not folder().is_dir():
        progress(f"no real records in {folder()}")
        return []
    metrics: list[Metric] = []
    counts: dict[str, list[Floats]] = {"detect": [], "plain correlation": []}
    for number, (name, plate) in enumerate(PLATES.items()):
        progress(f"windows of {name}")
        record, speed = read(plate), plate.speed_mm_per_us
        whole, ok, _ = detected(record, speed)
        truth = float(np.median(whole[ok]))
        if plate.thickness_mm is not None:
            off = abs(truth - plate.thickness_mm)
            metrics.append(Metric(f"whole record off nominal, {name}", off, "mm", "lower", 0.15))
        quarter = 0.25 / CENTRE_MHZ * speed / 2.0
        for title, method in (("detect", detected), ("plain correlation", plain)):
            of_windows = np.zeros((WINDOWS, 3))
            means: list[float] = []
            scaled: list[Floats] = []
            for k in range(WINDOWS):
                part = window(record, np.random.default_rng(SEED + 1000 * number + k))
                thickness, ok, sigma = method(part, speed)
                off = thickness - truth
                of_windows[k] = (ok & (np.abs(off) > quarter)).sum(), (~ok).sum(), len(part)
                if ok.any():
                    means.append(float(np.median(thickness[ok])))
                    scaled.append(np.abs(off[ok]) / sigma[ok])
            counts[title].append(of_windows)
            wrong, flagged, lines = of_windows.sum(axis=0)
            metrics += [
                Metric(f"wrong and unflagged, {name}, {title}", wrong / lines, "share", "lower"),
                Metric(f"flagged, {name}, {title}", flagged / lines, "share", "lower"),
                Metric(f"sd of windows, {name}, {title}", float(np.std(means)), "mm", "lower"),
            ]
            inside = float((np.concatenate(scaled) < 2.0).mean())
            metrics.append(Metric(f"within 2 sigma, {name}, {title}", inside, "share", "higher"))
    (wrong, flagged, lines), others = (
        np.concatenate(counts[title]).sum(axis=0) for title in ("detect", "plain correlation")
    )
    peer = "plain"
    return [
        *metrics,
        Metric(
            "wrong and unflagged, all windows",
            wrong / lines,
            "share",
            "lower",
            WRONG_SHARE,
            peer,
            others[0] / others[2],
        ),
        Metric(
            "flagged, all windows",
            flagged / lines,
            "share",
            "lower",
            FLAGGED_SHARE,
            peer,
            others[1] / others[2],
        ),
    ]
