"""From bytes to messages and back.

Those that carry bulk bytes are encoded and decoded by hand: protobuf would copy them once more.

Source: the Protocol Buffers encoding (protobuf.dev/programming-guides/encoding).
"""
from __future__ import annotations

import dataclasses
import struct
from typing import Any, Sequence, Union

from .._proto.voxelpipe.v1 import result_pb2
from ..errors import DataLoss
from .crc32c import crc32c

UPLOAD_PIECE_BYTES = 1 << 20
_VARINT, _BYTES, _FIXED32 = 0, 2, 5

Parts = Sequence[Union[bytes, memoryview]]  # of a message, to be joined


def _tag(field: int, wire_type: int) -> int:
    return field << 3 | wire_type


_PIECES = _tag(result_pb2.VoxelizeResponse.PIECES_FIELD_NUMBER, _BYTES)
_ARRAY = _tag(result_pb2.ResultPiece.ARRAY_FIELD_NUMBER, _VARINT)
_OFFSET = _tag(result_pb2.ResultPiece.OFFSET_FIELD_NUMBER, _VARINT)
_DATA = _tag(result_pb2.ResultPiece.DATA_FIELD_NUMBER, _BYTES)
_CRC32C = _tag(result_pb2.ResultPiece.CRC32C_FIELD_NUMBER, _FIXED32)
_UNCOMPRESSED = _tag(result_pb2.ResultPiece.UNCOMPRESSED_BYTES_FIELD_NUMBER, _VARINT)


def lost(why: str) -> DataLoss:
    """The error of a result that is not valid."""
    return DataLoss(f"the server's result: {why}")


@dataclasses.dataclass(slots=True)
class Piece:
    """A ResultPiece. `data` points into the message. uncompressed_bytes: None if it is not compressed."""

    array: int
    offset: int
    data: memoryview
    crc32c: int
    uncompressed_bytes: int | None

    @staticmethod
    def of(message: result_pb2.ResultPiece) -> "Piece":
        """From the service's message."""
        size = message.uncompressed_bytes if message.HasField("uncompressed_bytes") else None
        return Piece(message.array, message.offset, memoryview(message.data), message.crc32c, size)


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


def _signed(value: int, bits: int) -> int:
    """The number of a varint: its lowest bits, in two's complement."""
    value &= (1 << bits) - 1
    return value - (1 << bits) if value >> (bits - 1) else value


def read_pieces(message: bytes) -> list[Piece] | None:
    """A VoxelizeResponse that holds pieces, and nothing else; None for every other one, broken ones included."""
    pieces = []
    at = 0
    try:
        while at < len(message):
            if message[at] != _PIECES:
                return None
            length, at = _varint(message, at + 1)
            piece = _read_piece(message, at, at + length)
            if piece is None:
                return None
            pieces.append(piece)
            at += length
    except (IndexError, ValueError, struct.error):
        return None
    return pieces or None


def _read_piece(message: bytes, at: int, end: int) -> Piece | None:
    if end > len(message):
        return None
    piece = Piece(0, 0, memoryview(b""), 0, None)
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
        elif tag in (_ARRAY, _OFFSET, _UNCOMPRESSED):
            value, at = _varint(message, at)
            if tag == _ARRAY:
                piece.array = _signed(value, 32)
            elif tag == _OFFSET:
                piece.offset = _signed(value, 64)
            else:
                piece.uncompressed_bytes = _signed(value, 64)
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


def field(number: int, parts: Parts) -> Parts:
    """A field of a message or of bytes. In: its number, at most 15."""
    return [bytes([_tag(number, _BYTES)]), _written_varint(sum(map(len, parts))), *parts]


def number_field(number: int, value: int) -> bytes:
    """A field of a number of at least 0."""
    return bytes([_tag(number, _VARINT)]) + _written_varint(value)


def checked_bytes(data: memoryview, data_field: int, crc32c_field: int) -> Parts:
    """Two fields: bytes and their CRC-32C."""
    return [bytes([_tag(crc32c_field, _FIXED32)]), struct.pack("<I", crc32c(data)), *field(data_field, [data])]
