"""Sequence files: exact round trips, files as PLUS writes them, and damage named by its place."""

import importlib.util
import zlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rona_core.devices.files.poses.sequences import read_igs_mha, write_igs_mha
from rona_core.devices.recording import Recording
from rona_core.devices.samples import ToolTrack
from rona_core.errors import InvalidInputError
from tests.helpers.recordings import frames_like, same_frames
from tests.helpers.strategies import seeds

# A tracker's buffer as PLUS 2 writes it: fields by alphabet, no image, six digits, exponents of
# Windows, the frame numbers of the camera, the time since the program was started. Made by hand.
PLUS_HEAD = """ObjectType = Image
NDims = 3
AnatomicalOrientation = RAI
BinaryData = True
BinaryDataByteOrderMSB = False
CenterOfRotation = 0 0 0
CompressedData = False
DimSize = 0 0 3
Kinds = domain domain list
ElementSpacing = 1 1 1
ElementType = MET_OTHER
Offset = 0 0 0
TransformMatrix = 1 0 0 0 1 0 0 0 1
UltrasoundImageOrientation = XX
UltrasoundImageType = XX
"""
TURNED = "0.866025 -0.5 0 120.5 0.5 0.866025 0 -33.25 0 0 1 -1.25e-005 -0 0 -0 1 "
LEVEL = "1 0 0 101.129 0 1 0 -22.9939 0 0 1 88.1807 0 0 0 1"
PLUS = (
    (
        PLUS_HEAD
        + "".join(
            f"Seq_Frame{i:04d}_FrameNumber = {332203 + 2 * i}\n"
            f"Seq_Frame{i:04d}_ReferenceToTrackerTransform = {LEVEL}\n"
            f"Seq_Frame{i:04d}_ReferenceToTrackerTransformStatus = OK\n"
            f"Seq_Frame{i:04d}_StylusToTrackerTransform = {TURNED}\n"
            f"Seq_Frame{i:04d}_StylusToTrackerTransformStatus = {'INVALID' if i == 1 else 'OK'}\n"
            f"Seq_Frame{i:04d}_StylusToReferenceTransform = {TURNED}\n"
            f"Seq_Frame{i:04d}_StylusToReferenceTransformStatus = OK\n"
            f"Seq_Frame{i:04d}_Timestamp = {7415.679586 + 0.05 * i:.6f}\n"
            f"Seq_Frame{i:04d}_UnfilteredTimestamp = {7415.68 + 0.05 * i:.6f}\n"
            f"Seq_Frame{i:04d}_ImageStatus = INVALID\n"
            for i in range(3)
        )
        + "ElementDataFile = LOCAL\n"
    )
    .replace("0 0 3\n", "0 0 3                              \n")
    .encode()
)


@settings(max_examples=30)
@given(seed=seeds, n=st.integers(1, 25))
def test_every_bit_comes_back(seed, n):
    frames = frames_like(seed, n, tools=("toolmarker", "pointer6d", "Stylus2"))
    data = write_igs_mha(Recording.from_frames(frames))
    again = read_igs_mha(data)
    assert same_frames(list(again.frames()), frames)
    assert again.n_frames == n
    assert write_igs_mha(again) == data


def test_a_stored_capture_comes_back_with_the_count_of_its_frames():
    track = ToolTrack.from_frames("pointer6d", frames_like(3, 60))
    assert len(track.times_s) < 60
    again = read_igs_mha(write_igs_mha(Recording.from_track(track))).track("pointer6d")
    assert again.n_frames == 60
    np.testing.assert_array_equal(again.times_s, track.times_s)
    for part in ("rotations", "translations"):
        a, b = (getattr(t.Ts_tracker_marker, part) for t in (again, track))
        assert a.tobytes() == b.tobytes()


def test_more_than_ten_thousand_frames_keep_their_order():
    n = 10_002
    frames = frames_like(0, 1, tools=("pointer6d",))
    pose = frames[0].tools[0].T_tracker_marker
    track = ToolTrack(
        "pointer6d",
        np.arange(n),
        np.arange(n) / 60.0,
        type(Recording.from_frames(frames).tools[0].Ts_tracker_marker).stack([pose] * n),
        np.zeros(n),
        n,
    )
    again = read_igs_mha(write_igs_mha(Recording.from_track(track)))
    np.testing.assert_array_equal(again.times_s, track.times_s)


@pytest.mark.parametrize("end", [b"\n", b"\r\n"], ids=["unix", "windows"])
def test_a_file_of_plus_is_read(end):
    recording = read_igs_mha(PLUS.replace(b"\n", end), "stylus.igs.mha")
    assert [column.tool for column in recording.tools] == ["Reference", "Stylus"]
    np.testing.assert_array_equal(recording.numbers, [332203, 332205, 332207])
    np.testing.assert_allclose(recording.times_s, 7415.679586 + 0.05 * np.arange(3))
    stylus = recording.track("Stylus")
    np.testing.assert_array_equal(stylus.frame_numbers, [332203, 332207])
    np.testing.assert_array_equal(
        stylus.Ts_tracker_marker.translations, [[120.5, -33.25, -1.25e-5]] * 2
    )
    rotation = stylus.Ts_tracker_marker.rotations[0]
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-14)  # six digits, made so
    np.testing.assert_allclose(rotation[0], [np.cos(np.pi / 6), -0.5, 0.0], atol=1e-6)
    frames = list(recording.frames())
    assert [s.status for s in frames[1].tools] == ["ok", "out_of_view"]
    assert frames[0].tools[1].rms_error_mm is None


def with_image(compressed):
    """The same file with images of 4 x 5 pixels, its fields in another order."""
    lines = PLUS.decode().splitlines()[1:-1]
    pixels = bytes(range(60))
    body = zlib.compress(pixels) if compressed else pixels
    lines = [line for line in lines if not line.startswith(("DimSize", "ElementType", "Compress"))]
    lines = [line.replace("ImageStatus = INVALID", "ImageStatus = OK") for line in lines[::-1]]
    lines += ["DimSize = 4 5 3", "ElementType = MET_UCHAR", f"CompressedData = {compressed}"]
    if compressed:
        lines.append(f"CompressedDataSize = {len(body)}          ")
    text = "\n".join(["ObjectType = Image", *lines, "ElementDataFile = LOCAL\n"])
    return text.encode() + body


@pytest.mark.parametrize("compressed", [False, True])
def test_images_are_passed_over_and_the_order_of_fields_does_not_matter(compressed):
    plain, other = read_igs_mha(PLUS), read_igs_mha(with_image(compressed))
    for name in ("Stylus", "Reference"):
        a, b = plain.track(name), other.track(name)
        np.testing.assert_array_equal(a.Ts_tracker_marker.rotations, b.Ts_tracker_marker.rotations)
        np.testing.assert_array_equal(a.times_s, b.times_s)


def test_statuses_of_newer_and_older_versions():
    for word, status in (("MISSING", "out_of_view"), ("TOOL_OUT_OF_VOLUME", "out_of_volume")):
        recording = read_igs_mha(
            PLUS.replace(
                b"Status = INVALID\nSeq_Frame0001_StylusToR",
                f"Status = {word}\nSeq_Frame0001_StylusToR".encode(),
            )
        )
        assert recording.tool("Stylus").statuses[1] == status


def changed(old, new, data=PLUS, count=1):
    assert old in data
    return data.replace(old, new, count)


DAMAGE = {
    "empty": (b"", "is empty"),
    "another kind": (b"PK\x03\x04 zip", "begins with 'ObjectType = Image'"),
    "cut in the header": (PLUS[:1500], "cut off: expected 'ElementDataFile = LOCAL'"),
    "no equals sign": (changed(b"Offset = 0", b"Offset 0"), "line 12: expected 'name = value'"),
    "twice": (changed(b"Offset = 0 0 0", b"NDims = 3"), "line 12: NDims stands there twice"),
    "strange frame field": (changed(b"0000_FrameN", b"zero_FrameN"), "expected a field like"),
    "a frame missing": (changed(b"Seq_Frame0001", b"Seq_Frame0007", count=99), "frame 1 is miss"),
    "fewer than said": (changed(b"0 0 3 ", b"0 0 4 "), "DimSize says 4 frames.* of 3"),
    "no size": (changed(b"DimSize", b"DimSoze"), "DimSize: expected whole numbers"),
    "negative size": (changed(b"0 0 3 ", b"0 0 -3 "), "DimSize: expected whole numbers"),
    "dimensions": (changed(b"NDims = 3", b"NDims = 4"), "NDims says 4, DimSize has 3"),
    "no time": (changed(b"0001_Timestamp", b"0001_Timestomp"), "frame 1: Timestamp is missing"),
    "time in words": (changed(b"7415.679586", b"noon"), "frame 0, Timestamp.*finite number"),
    "time not finite": (changed(b"7415.679586", b"nan"), "frame 0, Timestamp.*finite number"),
    "time back": (changed(b"7415.779586", b"7415.6"), "time of each frame must be above"),
    "number": (changed(b"= 332205", b"= 1.5"), "FrameNumber: expected a whole number"),
    "huge number": (changed(b"= 332205", b"= 9" + b"9" * 5000), "expected a whole number"),
    "huge size": (changed(b"0 0 3 ", b"0 0 3" + b"3" * 5000), "DimSize: expected whole numbers"),
    "number back": (changed(b"= 332205", b"= 1"), "number of frame 1 .* above 332203"),
    "short matrix": (changed(b"101.129 ", b""), "frame 0, Ref.*16 numbers, got 15"),
    "words in a matrix": (changed(b"101.129", b"x"), "frame 0, Reference.*16 numbers"),
    "nan in a matrix": (changed(b"101.129", b"nan"), "frame 0, Reference.*finite"),
    "not rigid": (
        changed(LEVEL.encode(), b"2" + LEVEL[1:].encode()),
        "frame 0, Ref.*off by 3|by 3",
    ),
    "status": (changed(b"Status = OK", b"Status = FINE"), "expected OK or INVALID, got 'FINE'"),
    "no status": (changed(b"TransformStatus = OK", b"TransformStutus = OK"), "Status is missing"),
    "no transform": (
        changed(b"ToTracker", b"ToCamera", count=999),
        "in the frames Camera, Reference; got .Tracker",
    ),
    "same tool twice": (
        changed(b"Stylus", b"Pointer6D", changed(b"Reference", b"Pointer6d", count=999), 999),
        "two tools have the same name|stands there twice",
    ),
}


@pytest.mark.sweep(9)
@pytest.mark.parametrize(("data", "words"), DAMAGE.values(), ids=DAMAGE)
def test_damage_is_named_by_its_place(data, words):
    with pytest.raises(InvalidInputError, match=words) as refused:
        read_igs_mha(data, "my.igs.mha")
    assert str(refused.value).startswith("my.igs.mha")


@settings(max_examples=60)
@given(seed=seeds, data=st.data())
def test_any_damage_is_a_refusal_or_a_recording_never_a_crash(seed, data):
    """A byte changed or a piece cut out anywhere."""
    file = bytearray(write_igs_mha(Recording.from_frames(frames_like(seed % 3, 3))))
    at = data.draw(st.integers(0, len(file) - 1))
    if data.draw(st.booleans()):
        file[at] = data.draw(st.integers(0, 255))
    else:
        del file[at : at + data.draw(st.integers(1, 200))]
    try:
        recording = read_igs_mha(bytes(file))
    except InvalidInputError:
        return
    assert len(recording) >= 1


def test_a_tool_that_cannot_be_written_is_refused():
    for name in ("a b", "7up", "ProbeToTrackerX", "münze"):
        with pytest.raises(InvalidInputError, match="letters and digits"):
            write_igs_mha(Recording.from_frames(frames_like(0, 2, tools=(name,))))


@pytest.mark.skipif(not importlib.util.find_spec("SimpleITK"), reason="SimpleITK is not installed")
def test_simpleitk_reads_what_is_written(tmp_path):
    import SimpleITK

    frames = frames_like(8, 12)
    file = tmp_path / "x.igs.mha"
    file.write_bytes(write_igs_mha(Recording.from_frames(frames)))
    image = SimpleITK.ReadImage(str(file))
    assert image.GetSize() == (1, 1, 12)
    for i, frame in enumerate(frames):
        assert float(image.GetMetaData(f"Seq_Frame{i:04d}_Timestamp")) == frame.time_s
        words = image.GetMetaData(f"Seq_Frame{i:04d}_StylusToTrackerTransformStatus")
        assert words == ("OK" if frame.tools[1].status == "ok" else "INVALID")
