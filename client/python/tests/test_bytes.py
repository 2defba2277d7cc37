"""Checksums, and the messages that are encoded by hand."""
from __future__ import annotations

import os
import threading
from typing import Iterator

import pytest

from voxelpipe._calls import crc32c as _crc32c, wire as _wire
from voxelpipe._calls.ahead import received_ahead
from voxelpipe._calls.many import Requests
from voxelpipe._proto.voxelpipe.v1 import voxelization_service_pb2 as service


def slow_crc32c(data: bytes) -> int:
    state = 0xFFFFFFFF
    for byte in data:
        state ^= byte
        for _ in range(8):
            state = state >> 1 ^ (0x82F63B78 if state & 1 else 0)
    return state ^ 0xFFFFFFFF


@pytest.mark.parametrize("size", [0, 1, 9, 16384, 16385, 32767, 32768, 32769, 98304 + 5])
def test_every_crc32c_is_that_of_the_definition(size: int) -> None:
    data = os.urandom(size)
    assert _crc32c.crc32c_numpy(data) == slow_crc32c(data)
    assert _crc32c.crc32c(memoryview(data)) == slow_crc32c(data)


def test_crc32c_of_the_check_string() -> None:
    assert _crc32c.crc32c_numpy(b"123456789") == 0xE3069283


def piece(**fields: object) -> bytes:
    message = service.VoxelizeResponse(piece=service.ResultPiece(**fields))  # type: ignore[arg-type]
    return bytes(message.SerializeToString())


def test_pieces_are_read_as_protobuf_reads_them() -> None:
    data = os.urandom(300)
    read = _wire.read_piece(piece(target=7, offset=1 << 40, data=data, crc32c=0xFEDCBA98, raw_bytes=12345))
    assert read is not None
    assert (read.target, read.offset, bytes(read.data), read.crc32c, read.raw_bytes) == (
        7,
        1 << 40,
        data,
        0xFEDCBA98,
        12345,
    )


def test_other_messages_are_left_to_protobuf() -> None:
    summary = service.VoxelizeResponse(summary=service.Summary(result_bytes=5)).SerializeToString()
    assert _wire.read_piece(summary) is None
    assert _wire.read_piece(b"") is None
    whole = piece(target=1, offset=2, data=b"abc", crc32c=3)
    for end in range(1, len(whole)):
        assert _wire.read_piece(whole[:end]) is None
    assert _wire.read_piece(whole + b"\x08") is None


@pytest.mark.parametrize("size", [1, 127, 128, 1 << 20])
def test_written_pieces_are_what_protobuf_reads(size: int) -> None:
    data = os.urandom(size)
    field = service.VoxelizeRequest
    written = _wire.write_piece(memoryview(data), field.MESH_PIECE_FIELD_NUMBER, field.CRC32C_FIELD_NUMBER)
    message = service.VoxelizeRequest.FromString(written)
    assert message.mesh_piece == data
    assert message.crc32c == _crc32c.crc32c(data)


def test_jobs_that_wait_together_share_a_message() -> None:
    requests = Requests(5000)
    sizes = [10, 200, 3000, 3000, 9000, 0, 1]
    for number, size in enumerate(sizes):
        requests.put(service.VoxelizeManyRequest(id=number, mesh=os.urandom(size)).SerializeToString())
    requests.put(None)
    messages = [service.VoxelizeManyRequest.FromString(message) for message in requests]
    jobs = [[message.id, *(job.id for job in message.more)] for message in messages]
    assert jobs == [[0, 1, 2], [3], [4], [5, 6]]
    assert [len(job.mesh) for message in messages for job in (message, *message.more)] == sizes
    assert not any(job.more for message in messages for job in message.more)


class Call:
    """Like a call of gRPC: messages until it is cancelled or fails."""

    def __init__(self, count: int, failure: Exception | None = None) -> None:
        self.cancelled = threading.Event()
        self.count = count
        self.failure = failure

    def __iter__(self) -> Iterator[bytes]:
        for number in range(self.count):
            if self.cancelled.is_set():
                raise RuntimeError("cancelled")
            yield bytes([number])
        if self.failure is not None:
            raise self.failure

    def cancel(self) -> None:
        self.cancelled.set()


def test_messages_that_are_received_ahead_keep_their_order_and_the_error() -> None:
    assert list(received_ahead(Call(100))) == [bytes([number]) for number in range(100)]
    taken = []
    with pytest.raises(ValueError, match="lost"):
        for message in received_ahead(Call(30, ValueError("lost"))):
            taken.append(message)
    assert len(taken) == 30


def test_a_call_that_is_left_early_is_cancelled() -> None:
    before = threading.active_count()
    call = Call(200)
    messages = received_ahead(call)
    next(messages)
    messages.close()
    assert call.cancelled.is_set() and threading.active_count() <= before
