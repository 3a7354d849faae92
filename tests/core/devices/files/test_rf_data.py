"""Recorded lines: what is in a file comes out, and what cannot be meant is refused by name."""

import io

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from rona_core.devices.files.rf.rf_data import read_rf
from rona_core.devices.files.text_tables import NamedFile
from rona_core.errors import InvalidInputError

pytestmark = pytest.mark.usefixtures("readers_here")

N, SAMPLES, RATE_HZ = 7, 300, 40e6


def lines():
    t = np.arange(SAMPLES) / 40.0
    rng = np.random.default_rng(1)
    delay = 3.0 + rng.random((N, 1))
    return np.rint(900 * np.exp(-(((t - delay) / 0.4) ** 2)) * np.sin(2 * np.pi * 2.3 * t)).astype(
        np.int16
    )


def arrays(**changes):
    found = {
        "rf": lines(),
        "fs": RATE_HZ,
        "t0": 2.5e-6,
        "positions": np.arange(2.0 * N).reshape(N, 2),
    }
    found |= changes
    return {key: value for key, value in found.items() if value is not None}


def npz(**changes):
    data = io.BytesIO()
    np.savez_compressed(data, **arrays(**changes))
    return NamedFile("a.npz", data.getvalue())


def hdf5(matlab=False, **changes):
    data = io.BytesIO()
    with h5py.File(data, "w", userblock_size=512 if matlab else 0) as file:
        for key, value in arrays(**changes).items():
            item = np.atleast_2d(value).T if matlab else value
            file[key] = item
            if matlab:
                file[key].attrs["MATLAB_class"] = np.bytes_("double")
    return NamedFile("a.h5", data.getvalue())


def mat(**changes):
    data = io.BytesIO()
    savemat(data, arrays(**changes))
    return NamedFile("a.mat", data.getvalue())


KINDS = [npz, hdf5, lambda **c: hdf5(matlab=True, **c), mat]
IDS = ["npz", "HDF5", "MATLAB 7.3", "MATLAB 5"]


@pytest.mark.sweep(2)
@pytest.mark.parametrize("write", KINDS, ids=IDS)
def test_every_kind_of_file_gives_the_same_lines(write):
    read = read_rf(write())
    np.testing.assert_array_equal(read.rf, lines())
    assert read.sampling_mhz == pytest.approx(40.0)
    assert read.start_us == pytest.approx(2.5)
    assert read.start_known
    np.testing.assert_array_equal(read.positions_mm, np.arange(2.0 * N).reshape(N, 2))
    assert not read.rf.flags.writeable
    bare = read_rf(write(t0=None, positions=None))
    assert (bare.start_us, bare.start_known, bare.positions_mm) == (0.0, False, None)


@pytest.mark.sweep(1)
@pytest.mark.parametrize("write", KINDS, ids=IDS)
def test_positions_along_a_line_are_a_column(write):
    read = read_rf(write(positions=np.arange(float(N))))
    np.testing.assert_array_equal(read.positions_mm, np.arange(float(N))[:, None])


def test_one_line_is_one_scan():
    assert read_rf(npz(rf=lines()[:1], positions=None)).rf.shape == (1, SAMPLES)
    assert read_rf(npz(rf=lines()[:1], positions=[1.0, 2.0, 3.0])).positions_mm.shape == (1, 3)


@pytest.mark.sweep(4)
@pytest.mark.parametrize("write", KINDS, ids=IDS)
@pytest.mark.parametrize("kind", [np.int16, np.int8, np.uint8, np.float32, np.float64])
def test_samples_of_any_kind_and_numbers_in_any_shape_are_read(write, kind):
    rf = (lines() // 8).clip(0, 127).astype(kind)
    read = read_rf(write(rf=rf, fs=np.array([[RATE_HZ]]), t0=np.array([[-2.5e-6]])))
    np.testing.assert_array_equal(read.rf, rf)
    assert (read.sampling_mhz, read.start_us) == (40.0, pytest.approx(-2.5))


def test_a_matlab_file_without_class_names_has_its_axes_turned():
    data = bytearray(hdf5(matlab=True).data)
    data[:10] = b"MATLAB 7.3"
    with h5py.File(io.BytesIO(bytes(data)), "r") as file:
        plain = {key: np.asarray(file[key]) for key in file}
    bare = io.BytesIO()
    with h5py.File(bare, "w", userblock_size=512) as file:
        for key, value in plain.items():
            file[key] = value
    written = b"MATLAB 7.3" + bare.getvalue()[10:]
    np.testing.assert_array_equal(read_rf(NamedFile("a.mat", written)).rf, lines())


def test_scalars_of_hdf5_may_be_attributes():
    data = io.BytesIO()
    with h5py.File(data, "w") as file:
        file["rf"] = lines()
        file.attrs["fs"] = RATE_HZ
    assert read_rf(NamedFile("a.h5", data.getvalue())).sampling_mhz == pytest.approx(40.0)


WRONG = {
    "no rf": ({"rf": None, "data": np.zeros(3)}, "has no rf.*it holds data"),
    "no fs": ({"fs": None}, "has no fs"),
    "MHz": ({"fs": 40.0}, "if MHz are meant, write 4e"),
    "kHz": ({"fs": 40e3}, "if kHz are meant"),
    "negative rate": ({"fs": -40e6}, "in Hz"),
    "rate not finite": ({"fs": np.nan}, "one finite number"),
    "two rates": ({"fs": [1e7, 2e7]}, "one finite number"),
    "one axis": ({"rf": lines()[0]}, r"not .300,.; a single line is written as .1, 300."),
    "transposed, by its positions": (
        {"rf": lines()[:, :70].T.copy(), "positions": np.zeros((N, 2))},
        "samples are needed; it seems to be transposed",
    ),
    "positions of the other axis": (
        {"rf": np.ones((90, 1)) * np.arange(100), "positions": np.zeros((100, 2))},
        "seems to be transposed",
    ),
    "three axes": ({"rf": np.zeros((2, 3, 400))}, "shape .scans, samples., not .2, 3, 400."),
    "empty": ({"rf": np.zeros((0, 300))}, "shape"),
    "few samples": ({"rf": np.ones((2, 30))}, "at least 64 samples"),
    "few samples, many scans": ({"rf": lines()[:, :40].T.copy().T}, "at least 64"),
    "constant": ({"rf": np.full((N, SAMPLES), 3)}, "constant"),
    "complex": ({"rf": lines() * 1j}, "complex"),
    "words": ({"rf": np.full((N, SAMPLES), "a")}, "type"),
    "t0 in us": ({"t0": 2.5}, "t0 is 2.5 s: expected seconds"),
    "t0 not finite": ({"t0": np.inf}, "t0 must be one finite number"),
    "positions of others": ({"positions": np.zeros((N + 1, 2))}, r"\(7, 2\)"),
    "positions transposed": ({"positions": np.zeros((2, N))}, "transposed"),
    "positions not finite": ({"positions": np.full((N, 2), np.nan)}, "positions must be finite"),
    "positions in um": ({"positions": np.full((N, 2), 5e4)}, "expected millimetres"),
}


@pytest.mark.parametrize(("changes", "words"), WRONG.values(), ids=WRONG)
def test_what_cannot_be_meant_is_refused_by_name(changes, words):
    with pytest.raises(InvalidInputError, match=words) as error:
        read_rf(npz(**changes))
    assert "a.npz" in str(error.value)


def test_nan_is_refused_with_its_scan():
    rf = lines().astype(float)
    rf[4, 10] = np.nan
    with pytest.raises(InvalidInputError, match="1 of 2100 values are not, first in scan 4"):
        read_rf(npz(rf=rf))


def test_lines_the_wrong_way_round_are_refused():
    wide = np.repeat(lines(), 20, axis=0)[:, :120].astype(float)
    wide += np.random.default_rng(2).normal(0, 5, wide.shape)
    with pytest.raises(InvalidInputError, match="transposed"):
        read_rf(npz(rf=lines().T.copy(), positions=None))
    assert len(read_rf(npz(rf=wide, positions=None))) == 140  # more scans than samples is fine


def test_nothing_in_a_file_is_run():
    data = io.BytesIO()
    np.savez(data, rf=np.array([{"a": 1}], dtype=object), fs=RATE_HZ)
    with pytest.raises(InvalidInputError, match=r"damaged npz.*allow_pickle"):
        read_rf(NamedFile("a.npz", data.getvalue()))


def test_nothing_outside_the_file_is_opened(tmp_path):
    other = tmp_path / "other.h5"
    with h5py.File(other, "w") as file:
        file["rf"] = lines()
    data = io.BytesIO()
    with h5py.File(data, "w") as file:
        file["fs"] = RATE_HZ
        file["rf"] = h5py.ExternalLink(str(other), "rf")
    with pytest.raises(InvalidInputError, match="another file"):
        read_rf(NamedFile("a.h5", data.getvalue()))


@pytest.mark.sweep(3)
@pytest.mark.parametrize("write", [npz, hdf5, mat], ids=["npz", "HDF5", "MATLAB 5"])
@pytest.mark.parametrize("share", [0.2, 0.6, 0.95])
def test_a_damaged_file_is_named_and_nothing_else_is_thrown(write, share):
    data = write().data
    with pytest.raises(InvalidInputError):
        read_rf(NamedFile("a", data[: int(share * len(data))]))


def test_an_empty_file_is_called_so():
    with pytest.raises(InvalidInputError, match="is empty"):
        read_rf(NamedFile("a.h5", b""))


@pytest.mark.parametrize("data", [b"rf,fs\n1,2\n", b"\x89PNG\r\n\x1a\n" + bytes(300)])
def test_another_kind_of_file_is_refused(data):
    with pytest.raises(InvalidInputError, match="no HDF5, MATLAB"):
        read_rf(NamedFile("a.h5", data))


def test_lines_with_few_samples_a_cycle_are_no_transposed_ones_if_their_positions_say_so():
    t = np.arange(150) / 8.0  # 3.5 samples a cycle
    pulse = 900 * np.exp(-(((t - 6.0) / 1.5) ** 2)) * np.sin(2 * np.pi * 2.3 * t)
    rf = np.repeat(pulse[None], 400, axis=0)
    with pytest.raises(InvalidInputError, match="seems to be transposed; if it is not, give posit"):
        read_rf(npz(rf=rf, fs=8e6, positions=None))
    for positions in (np.arange(400.0), np.zeros((400, 2)), np.zeros((1, 400))):
        read = read_rf(npz(rf=rf, fs=8e6, positions=positions))
        np.testing.assert_array_equal(read.rf, rf)
    with pytest.raises(InvalidInputError, match="transposed"):
        read_rf(npz(rf=rf, fs=8e6, positions=np.zeros((150, 2))))
