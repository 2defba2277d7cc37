"""Checksums, and the messages that are encoded by hand."""
from __future__ import annotations

import os
import threading
from typing import Any, Iterator

import pytest

from voxelpipe import MeshFile
from voxelpipe._calls import crc32c as _crc32c, wire as _wire
from voxelpipe._calls.ahead import received_ahead
from voxelpipe._calls.many import Requests
from voxelpipe._calls.progress import Reporter
from voxelpipe._calls.session import Job, upload_messages
from voxelpipe._proto.voxelpipe.v1 import mesh_pb2, request_pb2, result_pb2
from voxelpipe._proto.voxelpipe.v1 import types_pb2 as types
from voxelpipe._proto.voxelpipe.v1 import voxelization_service_pb2 as service
from voxelpipe.options import make_request


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


def pieces(*listed: result_pb2.ResultPiece) -> bytes:
    return bytes(result_pb2.VoxelizeResponse(pieces=listed).SerializeToString())


def test_pieces_are_read_as_protobuf_reads_them() -> None:
    listed = [
        result_pb2.ResultPiece(
            array=7, offset=1 << 40, data=os.urandom(300), crc32c=0xFEDCBA98, uncompressed_bytes=12345
        ),
        result_pb2.ResultPiece(array=-1, offset=-1 << 63, data=b"abc", crc32c=1, uncompressed_bytes=-5),
        result_pb2.ResultPiece(array=(1 << 31) - 1, offset=(1 << 63) - 1, uncompressed_bytes=0),
        result_pb2.ResultPiece(data=os.urandom(1 << 17)),
        result_pb2.ResultPiece(),
    ]
    for count in range(1, len(listed) + 1):
        assert _wire.read_pieces(pieces(*listed[:count])) == [_wire.Piece.of(one) for one in listed[:count]]
    assert _wire.Piece.of(listed[2]).uncompressed_bytes == 0 and _wire.Piece.of(listed[3]).uncompressed_bytes is None


def test_numbers_beyond_their_type_are_cut_as_protobuf_cuts_them() -> None:
    number = b"\xfe\xff\xff\xff\xff\xff\xff\xff\xff\x7f"  # ten bytes, of which 64 bits count
    for tag in (b"\x08", b"\x10", b"\x28"):
        message = b"".join(_wire.field(4, [tag, number]))
        (expected,) = result_pb2.VoxelizeResponse.FromString(message).pieces
        assert _wire.read_pieces(message) == [_wire.Piece.of(expected)]


def test_other_messages_are_left_to_protobuf() -> None:
    summary = result_pb2.VoxelizeResponse(summary=result_pb2.Summary(result_bytes=5)).SerializeToString()
    assert _wire.read_pieces(summary) is None
    assert _wire.read_pieces(b"") is None
    whole = pieces(result_pb2.ResultPiece(array=1, offset=2, data=b"abc", crc32c=3))
    for end in range(1, len(whole)):
        assert _wire.read_pieces(whole[:end]) is None
        assert _wire.read_pieces(whole + whole[:end]) is None
    assert _wire.read_pieces(whole + b"\x08") is None
    assert _wire.read_pieces(whole + summary) is None and _wire.read_pieces(summary + whole) is None
    assert _wire.read_pieces(b"".join(_wire.field(4, [b"\x30\x01"]))) is None  # a piece with an unknown field


@pytest.mark.parametrize("size", [0, 1, 127, 128, 1 << 20])
def test_pieces_of_an_upload_are_what_protobuf_reads(size: int) -> None:
    data = os.urandom(size)
    field = service.VoxelizeUploadRequest
    parts = _wire.checked_bytes(memoryview(data), field.PIECE_FIELD_NUMBER, field.CRC32C_FIELD_NUMBER)
    message = service.VoxelizeUploadRequest.FromString(b"".join(parts))
    assert message.piece == data
    assert message.crc32c == _crc32c.crc32c(data)


NAME = f"meshes/{'7' * 64}-mm-stl"
DATA = os.urandom(3 << 19)
FILE = MeshFile(memoryview(DATA), types.MESH_FORMAT_STL, "a.stl", "mm")
REQUEST = make_request(resolution=9, priority="low", content_hash=True)
GIVEN: dict[str, Any] = {"format": types.MESH_FORMAT_STL, "unit": types.LENGTH_UNIT_MILLIMETRE}
CHECKED = {"data": DATA, "crc32c": _crc32c.crc32c(DATA)}
JOBS: dict[str, tuple[Job, dict[str, Any], dict[str, Any]]] = {
    "file": (Job(REQUEST, FILE), {"bytes": {**GIVEN, **CHECKED}}, {"bytes": GIVEN}),
    "stored": (Job(REQUEST, None, NAME), {"stored": {"name": NAME}}, {"stored": {"name": NAME}}),
    "positions": (
        Job(REQUEST, MeshFile(memoryview(DATA)), NAME),
        {"stored": {"name": NAME, "positions": CHECKED}},
        {"stored": {"name": NAME, "positions": {}}},
    ),
    "empty file": (Job(REQUEST, MeshFile(memoryview(b""))), {"bytes": {"crc32c": 0}}, {"bytes": {}}),
    "held": (Job(REQUEST, None), {"bytes": {}}, {"bytes": {}}),
}


def request_of(mesh: dict[str, Any]) -> request_pb2.VoxelizeRequest:
    message = request_pb2.VoxelizeRequest(mesh=request_pb2.MeshSource(**mesh))
    message.MergeFrom(REQUEST.message)
    return message


@pytest.mark.parametrize("name", JOBS)
def test_requests_that_are_joined_are_what_protobuf_reads(name: str) -> None:
    job, with_data, without = JOBS[name]
    report = Reporter(None)
    expected = request_of(with_data)
    assert request_pb2.VoxelizeRequest.FromString(job.whole(report)) == expected
    assert request_pb2.VoxelizeRequest.FromString(b"".join(job.message(False))) == request_of(without)
    (batched,) = service.VoxelizeBatchRequest.FromString(job.batch_job(1 << 40)).jobs
    assert (batched.id, batched.request) == (1 << 40, expected) and not batched.HasField("timeout")
    estimate = service.EstimateVoxelizationRequest.FromString(job.estimate())
    assert estimate == service.EstimateVoxelizationRequest(
        mesh=expected.mesh, spec=expected.spec, execution=expected.execution
    )
    first, *rest = map(service.VoxelizeUploadRequest.FromString, job.upload(report))
    assert first.request == request_of(without) and b"".join(message.piece for message in rest) == bytes(job.data)
    assert all(message.crc32c == _crc32c.crc32c(message.piece) for message in rest)


def test_an_upload_names_its_mesh() -> None:
    first, *rest = map(mesh_pb2.UploadMeshRequest.FromString, upload_messages(FILE, NAME, Reporter(None)))
    assert first.upload == mesh_pb2.MeshUpload(expected_id=NAME, **GIVEN)
    assert b"".join(message.piece for message in rest) == DATA and len(rest) == 2
    assert all(message.crc32c == _crc32c.crc32c(message.piece) for message in rest)


def test_jobs_that_wait_together_share_a_message() -> None:
    requests = Requests(5000)
    sizes = [10, 200, 3000, 3000, 9000, 0, 1]
    for number, size in enumerate(sizes):
        requests.put(Job(REQUEST, MeshFile(memoryview(os.urandom(size)))).batch_job(number))
        if number == 1:
            requests.cancel(7)
            requests.cancel(1 << 63)
    requests.put(None)
    messages = [service.VoxelizeBatchRequest.FromString(message) for message in requests]
    assert [[job.id for job in message.jobs] for message in messages] == [[0, 1, 2], [3], [4], [5, 6]]
    assert [len(job.request.mesh.bytes.data) for message in messages for job in message.jobs] == sizes
    assert [list(message.cancel) for message in messages] == [[7, 1 << 63], [], [], []]


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
