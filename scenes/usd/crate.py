"""Saving a growing ``.usdc`` so that a kill at any moment leaves a file that opens.

A binary layer ends in its tables (paths, fields, table of contents), and the header at its start says where they are.
On a repeated save OpenUSD writes new values *over* the old tables and the header last, so a process that dies in
between leaves a file without tables. Before such a save we copy the tables beyond everything the save will write and
point the header there; the file is then complete at every moment. The gap stays a hole and is cut off afterwards.

On a full disk OpenUSD writes the header all the same, and reads what did not get there back through a memory map, which
ends the process where the file system is one of memory. So we ask the disk for room first, and put the header back.

Layout: 8 bytes ``PXR-USDC``, 8 bytes version, int64 offset of the table of contents, the rest of an 88 byte header.
Table of contents: uint64 count, then per section a 16 byte name, int64 start, int64 size.
"""

import errno
import os
import struct
from pathlib import Path
from typing import Any, BinaryIO

MAGIC = b"PXR-USDC"
TOC_FIELD = 16
SECTION = struct.Struct("<16sqq")
HEADER = 88
MARGIN = 16 * 2**20
ROOM = 2**17  # bytes to ask the disk for beyond those known of


def save_again(layer: Any, path: Path, new_bytes: int) -> None:
    """Saves an ``Sdf.Layer`` that was saved before.

    Args:
        layer: the layer behind ``path``.
        path: its ``.usdc`` file.
        new_bytes: at least the size of the values set since the last save.

    Raises:
        Tf.ErrorException: when the layer cannot be written, e.g. on a full disk.
        OSError: likewise.
    """
    with path.open("r+b", buffering=0) as file:  # unbuffered: OpenUSD writes to the same file behind our back
        _keep_tables(file, new_bytes)
        file.seek(0)
        header = file.read(HEADER)
        try:
            layer.Save()
        except Exception:
            _write_all(file, 0, header)
            raise
        file.truncate(read_tables(file)[1])


def _keep_tables(file: BinaryIO, new_bytes: int) -> None:
    start, end, sections = read_tables(file)
    file.seek(start)
    tables = file.read(end - start)
    # New tables repeat the old ones and add a few dozen bytes per sample, which are far fewer than the margin holds.
    shift = 2 * new_bytes + 4 * len(tables) + MARGIN
    try:
        _ask_for_room(file, start, new_bytes + 2 * len(tables) + ROOM)
    except OSError:
        file.truncate(end)  # what it was given of the room
        raise
    contents = struct.pack("<Q", len(sections))
    contents += b"".join(SECTION.pack(name, at + shift, size) for name, at, size in sections)
    _write_all(file, start + shift, tables[: -len(contents)] + contents)
    _write_all(file, TOC_FIELD, struct.pack("<q", end + shift - len(contents)))


def _ask_for_room(file: BinaryIO, at: int, size: int) -> None:
    """Makes sure that writing there will not find the disk full, where the file system can say so.

    Raises:
        OSError: it is.
    """
    if not hasattr(os, "posix_fallocate"):
        return
    try:
        os.posix_fallocate(file.fileno(), at, size)
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
            raise


def _write_all(file: BinaryIO, at: int, data: bytes) -> None:
    """Writes all of ``data``; a disk that is nearly full takes a part of it at first, and refuses the next."""
    file.seek(at)
    left = memoryview(data)
    while left:
        left = left[file.write(left) :]


def read_tables(file: BinaryIO) -> tuple[int, int, list[tuple[bytes, int, int]]]:
    """First and last byte of the tables, and the sections as (name, start, size)."""
    file.seek(0)
    header = file.read(TOC_FIELD + 8)
    if header[:8] != MAGIC:
        raise OSError(f"{file.name} is not a binary USD layer any more")
    (toc,) = struct.unpack_from("<q", header, TOC_FIELD)
    file.seek(toc)
    (count,) = struct.unpack("<Q", file.read(8))
    sections = [SECTION.unpack(file.read(SECTION.size)) for _ in range(count)]
    return min(at for _, at, _ in sections), file.tell(), sections
