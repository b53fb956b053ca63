"""Saving a growing ``.usdc`` so that a kill at any moment leaves a file that opens.

A binary layer ends in its tables (paths, fields, table of contents), and the header at its start says where they are.
On a repeated save OpenUSD writes new values *over* the old tables and the header last, so a process that dies in
between leaves a file without tables. Before such a save we copy the tables beyond everything the save will write and
point the header there; the file is then complete at every moment. The gap stays a hole and is cut off afterwards.

Layout: 8 bytes ``PXR-USDC``, 8 bytes version, int64 offset of the table of contents, the rest of an 88 byte header.
Table of contents: uint64 count, then per section a 16 byte name, int64 start, int64 size.
"""

import struct
from pathlib import Path
from typing import Any, BinaryIO

MAGIC = b"PXR-USDC"
TOC_FIELD = 16
SECTION = struct.Struct("<16sqq")
MARGIN = 16 * 2**20


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
        layer.Save()
        file.truncate(read_tables(file)[1])


def _keep_tables(file: BinaryIO, new_bytes: int) -> None:
    start, end, sections = read_tables(file)
    file.seek(start)
    tables = file.read(end - start)
    # New tables repeat the old ones and add a few dozen bytes per sample, which are far fewer than the margin holds.
    shift = 2 * new_bytes + 4 * len(tables) + MARGIN
    contents = struct.pack("<Q", len(sections))
    contents += b"".join(SECTION.pack(name, at + shift, size) for name, at, size in sections)
    file.seek(start + shift)
    file.write(tables[: -len(contents)] + contents)
    file.seek(TOC_FIELD)
    file.write(struct.pack("<q", end + shift - len(contents)))


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
