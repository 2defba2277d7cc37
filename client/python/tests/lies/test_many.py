"""Answers to a batch that no honest server gives, and jobs that are no longer wanted."""
from __future__ import annotations

import threading
import time
from typing import Any, Iterable

import pytest

import voxelpipe
from voxelpipe import Client
from voxelpipe._proto.google.rpc import status_pb2
from voxelpipe._proto.voxelpipe.v1 import server_info_pb2
from voxelpipe._proto.voxelpipe.v1 import voxelization_service_pb2 as service

from .. import shapes
from .liar import Liar, ask_many, gridded, honest, replies, tell, tell_batch, whole

UNKNOWN_JOBS = {
    "index out of range": [whole((1 << 64) - 1)],
    "answered twice": [whole(0), whole(0)],
    "answered twice in one message": [whole(1) + whole(1)],
}
OF_MANY: dict[str, Any] = {"resolution": 4, "targets": "triangle_id:u32", "in_flight": 4}


@pytest.mark.parametrize("lie", UNKNOWN_JOBS)
def test_an_answer_to_no_job(liar: tuple[Liar, str], lie: str) -> None:
    tell_batch(liar[0], *UNKNOWN_JOBS[lie])
    with Client(liar[1], retries=0, timeout=20) as client:
        with pytest.raises(voxelpipe.DataLoss, match="to job [0-9]+, which waits for none"):
            list(client.voxelize_many([shapes.cube()] * 2, **OF_MANY))
        results = list(client.voxelize_many([shapes.cube()] * 2, errors="return", **OF_MANY))
        assert len(results) == 2 and any(isinstance(result, voxelpipe.DataLoss) for result in results)


def test_jobs_without_an_answer_are_made_alone(liar: tuple[Liar, str]) -> None:
    tell_batch(liar[0], whole(1), [])
    with Client(liar[1], retries=0, timeout=20) as client:
        results = list(client.voxelize_many([shapes.cube()] * 2, **OF_MANY))
    assert results[0] == results[1]


def test_an_empty_reply_is_no_result(liar: tuple[Liar, str]) -> None:
    tell_batch(liar[0], [service.BatchReply(id=0)] + whole(0))
    assert ask_many(liar[1]).dims == (4, 4, 4)


def requested(requests: Iterable[bytes]) -> Iterable[service.VoxelizeBatchRequest]:
    return map(service.VoxelizeBatchRequest.FromString, requests)


def test_the_rest_of_a_refused_result_is_left_out_and_not_wanted(liar: tuple[Liar, str]) -> None:
    broken = honest("dense")
    gridded("voxel_size", "x", 0)(broken)
    cancelled: list[int] = []

    def answer(requests: Any, _: Any) -> Iterable[bytes]:
        first = replies(broken.parts())
        yield service.VoxelizeBatchResponse(replies=first[:3]).SerializeToString()
        for request in requested(requests):
            cancelled.extend(request.cancel)
            if cancelled:
                break
        yield service.VoxelizeBatchResponse(replies=first[3:] + whole(1)).SerializeToString()

    tell_batch(liar[0])
    liar[0].answers["VoxelizeBatch"] = answer
    with Client(liar[1], retries=0, timeout=20) as client:
        results = list(client.voxelize_many([shapes.cube()] * 2, errors="return", **OF_MANY))
    assert isinstance(results[0], voxelpipe.DataLoss) and isinstance(results[1], voxelpipe.VoxelGrid)
    assert cancelled == [0]


def late(liar: tuple[Liar, str], answer: Any) -> list[Any]:
    """The results of three jobs within half a second each, none of them made alone."""
    tell_batch(liar[0])
    liar[0].answers["VoxelizeBatch"] = answer
    del liar[0].answers["Voxelize"]
    with Client(liar[1], retries=0, timeout=0.5) as client:
        return list(client.voxelize_many([shapes.cube()] * 3, errors="return", **OF_MANY))


def test_a_late_job_is_cancelled_alone(liar: tuple[Liar, str]) -> None:
    def ended(number: int) -> list[service.BatchReply]:
        """Job 1 ends with CANCELLED; the result of job 2 was ready first."""
        cancelled = service.BatchReply(id=number, error=status_pb2.Status(code=1))
        return [cancelled] if number == 1 else whole(number)

    def answer(requests: Any, _: Any) -> Iterable[bytes]:
        yield service.VoxelizeBatchResponse(replies=whole(0)).SerializeToString()
        for request in requested(requests):
            for number in request.cancel:
                yield service.VoxelizeBatchResponse(replies=ended(number)).SerializeToString()

    results = late(liar, answer)
    assert [type(result).__name__ for result in results] == ["VoxelGrid", "DeadlineExceeded", "VoxelGrid"]
    assert "not done within the timeout" in str(results[1])


def test_a_server_that_does_not_cancel_is_left(liar: tuple[Liar, str]) -> None:
    def answer(_: Any, context: Any) -> Iterable[bytes]:
        yield service.VoxelizeBatchResponse(replies=whole(0)).SerializeToString()
        ended = threading.Event()
        context.add_callback(ended.set)
        ended.wait(20)

    begin = time.monotonic()
    results = late(liar, answer)
    assert [type(result).__name__ for result in results] == ["VoxelGrid", "DeadlineExceeded", "DeadlineExceeded"]
    assert time.monotonic() - begin < 10


def test_a_job_that_the_server_cancels_is_not_late(liar: tuple[Liar, str]) -> None:
    tell_batch(liar[0], [service.BatchReply(id=0, error=status_pb2.Status(code=1, message="by an administrator"))])
    with pytest.raises(voxelpipe.errors.Cancelled, match="by an administrator"):
        ask_many(liar[1])


def test_bytes_that_are_no_message_of_many(liar: tuple[Liar, str]) -> None:
    tell(liar[0], honest("dense"))
    liar[0].answers["VoxelizeBatch"] = lambda *_: [b"\xff" * 9]
    with pytest.raises(voxelpipe.DataLoss, match="cannot be read"):
        ask_many(liar[1])


@pytest.mark.parametrize("most_bytes", [0, 1000])
def test_messages_without_room_for_a_job(liar: tuple[Liar, str], most_bytes: int) -> None:
    tell(liar[0], honest("dense"))
    info = server_info_pb2.GetServerInfoResponse(
        limits=server_info_pb2.ServerLimits(max_message_bytes=most_bytes)
    )
    liar[0].answers["GetServerInfo"] = lambda *_: [info.SerializeToString()]
    with pytest.raises(voxelpipe.DataLoss, match=f"messages of at most {most_bytes} bytes"):
        ask_many(liar[1])


def test_an_error_of_the_code_ok(liar: tuple[Liar, str]) -> None:
    tell_batch(liar[0], [service.BatchReply(id=0, error=status_pb2.Status(code=0, message="fine"))])
    with pytest.raises(voxelpipe.DataLoss, match="an error of the code OK"):
        ask_many(liar[1])


def test_many_of_a_server_of_another_contract(liar: tuple[Liar, str]) -> None:
    with pytest.raises(voxelpipe.errors.NotSupported, match="another version of the contract"):
        ask_many(liar[1])
    tell(liar[0], honest("dense"))
    del liar[0].answers["VoxelizeBatch"], liar[0].answers["Voxelize"]
    with pytest.raises(voxelpipe.errors.NotSupported, match="another version of the contract"):
        ask_many(liar[1])
