"""Small files that unpack to much, or say that they do; and how much memory reading one takes."""

import gzip
import io
import multiprocessing
import resource
import struct
import zipfile
import zlib
from pathlib import Path

import numpy as np

from rona_core.devices.files.poses.recorded_poses import read_pivot
from rona_core.devices.files.rf.rf_data import read_rf
from rona_core.devices.files.text_tables import NamedFile
from rona_core.virtual.specimen.import_skull import import_skull

ZEROS = 1 << 24  # bytes of the block that is repeated
# processes are forked from one that has the readers loaded, with what they load on their first
# call, and has opened nothing yet
APART = multiprocessing.get_context("forkserver")
APART.set_forkserver_preload([__name__, "rona_core.session.files", "scipy.signal"])


def peak_kb():
    lines = Path("/proc/self/status").read_text().splitlines()
    return int(next(line for line in lines if line.startswith("VmHWM")).split()[1])


def measure(answer, reader, arguments):
    """Call ``reader`` and answer what it raised and by how many MB memory grew."""
    resource.setrlimit(resource.RLIMIT_AS, (6 << 30, 6 << 30))  # spares the machine
    Path("/proc/self/clear_refs").write_text("5")
    before = peak_kb()
    try:
        reader(*arguments)
        words = ""
    except Exception as error:
        words = f"{type(error).__name__}: {error}"
    grown = (peak_kb() - before) / 1024
    child = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    answer.send((words, max(grown, child - before / 1024)))


def measured(reader, *arguments):
    """Return what ``reader``, a function of a module, raised, and by how many MB memory grew."""
    plain = [str(a) if isinstance(a, Path) else a for a in arguments]
    receiver, sender = APART.Pipe(duplex=False)
    with receiver:
        process = APART.Process(target=measure, args=(sender, reader, plain))
        process.start()
        sender.close()
        try:
            assert receiver.poll(300), f"{reader.__name__} takes longer than 300 s"
            return receiver.recv()
        finally:
            process.kill()
            process.join()


def read_rf_at(path):
    with open(path, "rb") as file:
        return read_rf(NamedFile(path, file.read()))


def read_pivot_at(path):
    with open(path, "rb") as file:
        return read_pivot([NamedFile(path, file.read())])


def import_masked(path):
    return import_skull(path, threshold=0.5)


def import_far_off(path):
    return import_skull(path, threshold=0.5, center=(1.0, 2.0, 3.0))


def deflated(start: bytes, count: int) -> bytes:
    """Raw deflate of some bytes and then ``count`` zeros, or a little more."""
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    begin = packer.compress(start) + packer.flush(zlib.Z_FULL_FLUSH)
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    block = packer.compress(bytes(ZEROS)) + packer.flush(zlib.Z_FULL_FLUSH)
    end = zlib.compressobj(9, zlib.DEFLATED, -15).flush()
    return begin + block * -(-count // ZEROS) + end


def zlibbed(start: bytes, count: int) -> bytes:
    return b"\x78\x9c" + deflated(start, count) + bytes(4)


def gzipped(start: bytes, count: int) -> bytes:
    return b"\x1f\x8b\x08\0\0\0\0\0\0\x03" + deflated(start, count) + bytes(8)


def zipped(members: dict[str, tuple[bytes, int]]) -> bytes:
    """A zip of deflated members and the sizes that it tells of them."""
    out, directory = io.BytesIO(), b""
    for name, (packed, told) in members.items():
        at = out.tell()
        sizes = struct.pack("<HHHHIII", 0, 8, 0, 33, 0, len(packed), told)
        out.write(b"PK\x03\x04" + struct.pack("<H", 20) + sizes)
        out.write(struct.pack("<HH", len(name), 0) + name.encode() + packed)
        directory += b"PK\x01\x02" + struct.pack("<HH", 20, 20) + sizes
        directory += struct.pack("<HHHHHII", len(name), 0, 0, 0, 0, 0, at) + name.encode()
    where, count = out.tell(), len(members)
    end = struct.pack("<HHHHIIH", 0, 0, count, count, len(directory), where, 0)
    return out.getvalue() + directory + b"PK\x05\x06" + end


def plain_zip(members: dict[str, bytes]) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return out.getvalue()


def nearly_solid(n, hollow):
    """A block of bone about a cavity, both in voxels, with air on all sides."""
    mask = np.zeros((n,) * 3, dtype=np.uint8)
    rim = n // 16
    mask[rim:-rim, rim:-rim, rim:-rim] = 1
    side = np.arange(n) - n / 2
    mask[side[:, None, None] ** 2 + side[:, None] ** 2 + side**2 < hollow**2] = 0
    return mask


def lost_head(n, outer, inner):
    """A small hollow ball and a plate in a wide volume."""
    mask = np.zeros((n,) * 3, dtype=np.uint8, order="F")
    middle = slice(n // 2 - outer - 2, n // 2 + outer + 3)
    side = np.arange(-outer - 2, outer + 3)
    r2 = side[:, None, None] ** 2 + side[:, None] ** 2 + side**2
    mask[middle, middle, middle] = (r2 <= outer**2) & (r2 > inner**2)
    mask[:, :, -8:] = 1
    return mask


def nifti_mask(mask, voxel_mm):
    """A mask on an upright grid."""
    head = bytearray(352)
    struct.pack_into("<i", head, 0, 348)
    struct.pack_into("<8h", head, 40, 3, *mask.shape, 1, 1, 1, 1)
    struct.pack_into("<hh", head, 70, 2, 8)
    struct.pack_into("<f", head, 108, 352)
    struct.pack_into("<B", head, 123, 2)
    struct.pack_into("<h", head, 254, 1)
    affine = np.diag((voxel_mm,) * 3 + (0.0,))[:3]
    struct.pack_into("<8f", head, 76, 1, voxel_mm, voxel_mm, voxel_mm, 0, 0, 0, 0)
    struct.pack_into("<12f", head, 280, *affine.ravel())
    head[344:348] = b"n+1\0"
    return gzip.compress(bytes(head) + mask.tobytes("F"), 1)
