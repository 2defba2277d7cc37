"""From bytes to messages and back.

The two that carry bulk bytes are encoded and decoded by hand: protobuf would copy them once more.

Source: the Protocol Buffers encoding (protobuf.dev/programming-guides/encoding).
"""
from __future__ import annotations

import dataclasses
import struct
from typing import Any

from .._proto.voxelpipe.v1 import voxelization_service_pb2 as service
from ..errors import DataLoss
from .crc32c import crc32c

UPLOAD_PIECE_BYTES = 1 << 20
_VARINT, _FIXED64, _BYTES, _FIXED32 = 0, 1, 2, 5


def _tag(field: int, wire_type: int) -> int:
    return field << 3 | wire_type


_PIECE = _tag(service.VoxelizeResponse.PIECE_FIELD_NUMBER, _BYTES)
_TARGET = _tag(service.ResultPiece.TARGET_FIELD_NUMBER, _VARINT)
_OFFSET = _tag(service.ResultPiece.OFFSET_FIELD_NUMBER, _VARINT)
_DATA = _tag(service.ResultPiece.DATA_FIELD_NUMBER, _BYTES)
_CRC32C = _tag(service.ResultPiece.CRC32C_FIELD_NUMBER, _FIXED32)
_RAW_BYTES = _tag(service.ResultPiece.RAW_BYTES_FIELD_NUMBER, _VARINT)


@dataclasses.dataclass(slots=True)
class Piece:
    """A ResultPiece. `data` points into the message."""

    target: int
    offset: int
    data: memoryview
    crc32c: int
    raw_bytes: int


def parsed(kind: Any, data: bytes | None) -> Any:
    """The message of a class that a server's bytes hold. In: None: the call ended without any. Errors: DataLoss."""
    if data is None:
        raise DataLoss("the server's answer: it has no message")
    message = kind()
    failure: Exception | None = None
    try:
        whole = message.MergeFromString(data) == len(data)  # the end of a group that did not begin: a warning only
    except Exception as error:  # protobuf's DecodeError has no public base; pure Python: UnicodeDecodeError too
        whole, failure = False, error
    if not whole:
        raise DataLoss("the server's answer: a message that cannot be read") from failure
    return message


def _varint(data: bytes, at: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        byte = data[at]
        at += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, at
        shift += 7
        if shift > 63:
            raise ValueError("a varint of more than ten bytes")


def read_piece(message: bytes) -> Piece | None:
    """A VoxelizeResponse that holds a piece, and nothing else; None for every other one, broken ones included."""
    try:
        return _read_piece(message)
    except (IndexError, ValueError, struct.error):
        return None


def _read_piece(message: bytes) -> Piece | None:
    if not message or message[0] != _PIECE:
        return None
    length, at = _varint(message, 1)
    end = at + length
    if end != len(message):
        return None
    piece = Piece(0, 0, memoryview(b""), 0, 0)
    while at < end:
        tag, at = _varint(message, at)
        if tag == _DATA:
            length, at = _varint(message, at)
            if at + length > end:
                return None
            piece.data = memoryview(message)[at : at + length]
            at += length
        elif tag == _CRC32C:
            (piece.crc32c,) = struct.unpack_from("<I", message, at)
            at += 4
        elif tag in (_TARGET, _OFFSET, _RAW_BYTES):
            value, at = _varint(message, at)
            if tag == _TARGET:
                piece.target = value & 0xFFFFFFFF
            elif tag == _OFFSET:
                piece.offset = value
            else:
                piece.raw_bytes = value
        else:
            return None  # a field of a newer server: left to protobuf
    return piece if at == end else None


def _written_varint(value: int) -> bytes:
    written = bytearray()
    while value >= 0x80:
        written.append(value & 0x7F | 0x80)
        value >>= 7
    written.append(value)
    return bytes(written)


def write_piece(data: memoryview, piece_field: int, crc32c_field: int) -> bytes:
    """A request message with bytes of a mesh and their CRC-32C."""
    return b"".join(
        (
            bytes([_tag(crc32c_field, _FIXED32)]),
            struct.pack("<I", crc32c(data)),
            bytes([_tag(piece_field, _BYTES)]),
            _written_varint(len(data)),
            data,
        )
    )


def joined_jobs(jobs: list[bytes]) -> bytes:
    """One VoxelizeManyRequest of several: the first one with the others in `more`."""
    parts = [jobs[0]]
    tag = bytes([_tag(service.VoxelizeManyRequest.MORE_FIELD_NUMBER, _BYTES)])
    for job in jobs[1:]:
        parts += (tag, _written_varint(len(job)), job)
    return b"".join(parts)
