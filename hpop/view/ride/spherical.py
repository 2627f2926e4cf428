"""What tells a player that a video is all round: the boxes st3d and sv3d of Spherical Video V2, put into an MP4 file.

https://github.com/google/spatial-media/blob/master/docs/spherical-video-v2-rfc.md: mono, equirectangular, not turned.
They belong in the description of the track's samples, which is in the box moov. As that is the last one of the file,
no place of a sample changes when it grows.
"""

from __future__ import annotations

import struct
from typing import BinaryIO

MADE_BY = b"hpop\0"
PATH = (b"trak", b"mdia", b"minf", b"stbl", b"stsd")
DESCRIPTIONS = 16  # bytes of stsd before its entries: size, type, version and flags, number of entries
SAMPLE_ENTRY = b"avc1"


def mark_spherical(file: BinaryIO) -> None:
    """Put the boxes into an open MP4 file whose moov comes last; ValueError where it does not."""
    start, moov = _last_box(file)
    if moov[4:8] != b"moov":
        raise ValueError(f"expected an MP4 file whose last box is moov, got {moov[4:8]!r}")
    grown = _with_added(moov, PATH, _stereo() + _spherical())
    file.seek(start)
    file.write(grown)


def _last_box(file: BinaryIO) -> tuple[int, bytes]:
    """Where the last box of a file begins, and the box."""
    end, start = file.seek(0, 2), 0
    while True:
        file.seek(start)
        size, _ = struct.unpack(">I4s", file.read(8))
        if size == 1:  # a long one: its size follows
            (size,) = struct.unpack(">Q", file.read(8))
        if start + size >= end:
            file.seek(start)
            return start, file.read(size)
        start += size


def _with_added(box: bytes, path: tuple[bytes, ...], added: bytes) -> bytes:
    """A box with more at the end of the sample entry to which a path of boxes leads."""
    head = DESCRIPTIONS if box[4:8] == b"stsd" else 8
    kind = path[0] if path else SAMPLE_ENTRY
    parts = [box[:head]]
    at, is_found = head, False
    while at < len(box):
        size, name = struct.unpack(">I4s", box[at : at + 8])
        child = box[at : at + size]
        if name == kind and not is_found:
            child = _with_added(child, path[1:], added) if path else _box(name, child[8:] + added)
            is_found = True
        parts.append(child)
        at += size
    if not is_found:
        raise ValueError(f"expected a box {kind!r} in {box[4:8]!r}")
    body = b"".join(parts)
    return struct.pack(">I", len(body)) + body[4:]


def _box(name: bytes, content: bytes) -> bytes:
    return struct.pack(">I4s", 8 + len(content), name) + content


def _full_box(name: bytes, content: bytes) -> bytes:
    """A box with version 0 and no flags."""
    return _box(name, bytes(4) + content)


def _stereo() -> bytes:
    """One picture for both eyes."""
    return _full_box(b"st3d", bytes(1))


def _spherical() -> bytes:
    """Equirectangular, the whole sphere; yaw, pitch and roll 0."""
    projection = _full_box(b"prhd", bytes(12)) + _full_box(b"equi", bytes(16))
    return _box(b"sv3d", _full_box(b"svhd", MADE_BY) + _box(b"proj", projection))
