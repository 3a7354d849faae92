"""Nothing outside of a file is opened because the file says so; pipes never hang a reader."""

import io
import os
import signal
from pathlib import Path

import h5py
import nibabel
import numpy as np
import pytest
import trimesh

from rona_core.devices.files.poses.sequences import read_igs_mha
from rona_core.devices.files.reader_process import read_apart
from rona_core.devices.files.rf.rf_data import read_rf
from rona_core.devices.files.size_limits import read_file
from rona_core.devices.files.text_tables import NamedFile
from rona_core.devices.files.triangle_file import read_triangles
from rona_core.errors import InvalidInputError, NotFoundError
from rona_core.session.files import load_session
from rona_core.virtual.specimen.import_skull import import_skull
from tests.helpers.readers_apart import breaking, crashing, greedy, modest

RATE_HZ = 4e7


@pytest.fixture
def pipe(tmp_path):
    """A pipe that nobody writes to: whoever opens it waits for ever."""
    path = tmp_path / "pipe"
    os.mkfifo(path)
    return path


@pytest.fixture(autouse=True)
def _soon():
    """A reader that hangs fails the test instead of the run."""

    def late(number, frame):
        raise TimeoutError("a reader hangs")

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(60)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


def detached(target, word="data file", end="\n"):
    return (
        "NRRD0004\ntype: unsigned char\ndimension: 3\nsizes: 100 100 100\nencoding: raw\n"
        f"spacings: 1 1 1\n{word}: {target}\n{end}"
    ).encode()


@pytest.mark.parametrize("word", ["data file", "datafile", "Data File", "DATAFILE"])
@pytest.mark.parametrize("end", ["\n", ""], ids=["whole header", "header without end"])
def test_an_nrrd_that_points_elsewhere_is_refused_unopened(tmp_path, pipe, word, end):
    other = tmp_path / "private.raw"
    other.write_bytes(np.random.default_rng(0).bytes(100**3))
    for target in (other, pipe, "private.raw", "LIST", "/etc/passwd"):
        path = tmp_path / "a.nrrd"
        path.write_bytes(detached(target, word, end))
        with pytest.raises(InvalidInputError, match=r"another file|has no end|could not") as error:
            import_skull(path)
        assert str(other.stat().st_size) not in str(error.value)


def test_a_nifti_pair_is_refused(tmp_path):
    pair = nibabel.Nifti1Pair(np.zeros((20, 20, 20), np.uint8), np.eye(4))
    nibabel.save(pair, tmp_path / "a.img")
    (tmp_path / "a.nii").write_bytes((tmp_path / "a.hdr").read_bytes() + bytes(8000))
    with pytest.raises(InvalidInputError, match="another file"):
        import_skull(tmp_path / "a.nii")


def outside(tmp_path):
    other = tmp_path / "other.h5"
    with h5py.File(other, "w") as file:
        file["rf"] = np.random.default_rng(0).normal(size=(4, 100))
    (tmp_path / "raw").write_bytes(bytes(8 * 400))
    return other


def virtual(file, other):
    layout = h5py.VirtualLayout(shape=(4, 100), dtype="f8")
    layout[:] = h5py.VirtualSource(other, "rf", shape=(4, 100))
    file.create_virtual_dataset("rf", layout)


def soft(file, other):
    file["door"] = h5py.ExternalLink(str(other), "/")
    file["rf"] = h5py.SoftLink("/door/rf")


LINKS = {
    "external link": lambda f, other: f.__setitem__("rf", h5py.ExternalLink(str(other), "rf")),
    "soft link through an external one": soft,
    "virtual": virtual,
    "external raw data": lambda f, other: f.create_dataset(
        "rf", shape=(4, 100), dtype="f8", external=[(str(other.parent / "raw"), 0, 3200)]
    ),
}


@pytest.mark.parametrize("link", LINKS.values(), ids=LINKS)
def test_an_hdf5_file_that_points_elsewhere_is_refused(tmp_path, link):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["fs"] = RATE_HZ
        link(file, outside(tmp_path))
    with pytest.raises(InvalidInputError, match="lies in another file"):
        read_rf(NamedFile("a.h5", (tmp_path / "a.h5").read_bytes()))


def test_what_a_mesh_names_is_not_looked_for(tmp_path, pipe):
    ball = trimesh.creation.icosphere(3, 70.0).export(file_type="obj")
    (tmp_path / "a.obj").write_text(f"mtllib pipe\nmtllib {pipe}\nusemtl x\n{ball}")
    (tmp_path / "b.obj").write_text(ball)
    made, plain = (read_triangles(tmp_path / name, name) for name in ("a.obj", "b.obj"))
    np.testing.assert_array_equal(made.vertices, plain.vertices)  # the material changes nothing
    np.testing.assert_array_equal(made.faces, plain.faces)


def test_a_sequence_whose_pixels_are_elsewhere_is_read_without_them(pipe):
    lines = ["ObjectType = Image", "NDims = 3", "DimSize = 1 1 1", "Seq_Frame0000_Timestamp = 0"]
    lines.append("Seq_Frame0000_ProbeToTrackerTransform = 1 0 0 1 0 1 0 2 0 0 1 900 0 0 0 1")
    recording = read_igs_mha("\n".join([*lines, f"ElementDataFile = {pipe}\n"]).encode())
    assert len(recording.tool("Probe").Ts_tracker_marker) == 1


@pytest.mark.parametrize("name", ["a.nrrd", "a.nii", "a.nii.gz", "a.stl", "a.ply", "a.obj"])
def test_pipes_folders_and_devices_are_no_skulls(tmp_path, name):
    for make in (os.mkfifo, os.mkdir, lambda path: os.symlink("/dev/zero", path)):
        path = tmp_path / f"{make.__name__.strip('<>')}-{name}"
        make(path)
        with pytest.raises(InvalidInputError):
            import_skull(path)


def test_a_pipe_is_no_file(pipe):
    with pytest.raises(InvalidInputError, match="is a pipe or a device: expected a recording"):
        read_file(pipe, "a recording")
    with pytest.raises(InvalidInputError, match="is a pipe or a device"):
        read_file(Path("/dev/zero"), "a recording")
    with pytest.raises(InvalidInputError, match="is a folder"):
        read_file(pipe.parent, "a recording")
    with pytest.raises(InvalidInputError, match="there is no file"):
        read_file(pipe.parent / "none", "a recording")
    with pytest.raises(NotFoundError):
        load_session(pipe)


# ------------------------------------------------------------------ a process of its own


def test_a_crash_of_a_library_is_told_and_survived():
    with pytest.raises(InvalidInputError, match=r"a\.mat is a damaged MATLAB file.*SIGSEGV"):
        read_apart(crashing, b"x", "a.mat", "MATLAB")


def test_memory_without_end_is_told_and_survived():
    with pytest.raises(InvalidInputError, match="needs more than 1074 MB"):
        read_apart(greedy, b"x", "a.mat", "MATLAB")


def test_whatever_a_library_throws_is_damage():
    with pytest.raises(InvalidInputError, match=r"a.mat is a damaged MATLAB file: 'half.*word'"):
        read_apart(breaking, b"x", "a.mat", "MATLAB")


def test_what_is_found_comes_back(tmp_path):
    found = read_apart(modest, b"abc", "a", "text")
    assert found["b"] is None
    assert found["a"].tobytes() == b"abc"
    (tmp_path / "file").write_bytes(io.BytesIO(b"def").getvalue())
    assert read_apart(modest, tmp_path / "file", "a", "text")["a"].tobytes() == b"def"
