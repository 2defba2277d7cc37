"""The transport of Client: its coroutines block, and never suspend."""
from __future__ import annotations

import contextlib
import time
from typing import Any, Callable, Iterator, TypeVar

from ..errors import VoxelpipeError
from ..grid import VoxelGrid
from .ahead import received_ahead
from .connection import Connection
from .grpc_module import grpc
from .progress import Reporter
from .reader import ResultReader
from .session import SMALL_BYTES, Job

_SMALL_RESULT_BYTES = 4 * SMALL_BYTES  # of all messages of a result that fits into one, with those of progress
_Result = TypeVar("_Result")


class Blocking:
    """A server_calls.Transport of a connection."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    async def unary(self, name: str, request: bytes, timeout: float | None) -> bytes | None:
        return self._connection.unary(name, request, timeout)[0]

    async def upload(self, name: str, requests: Iterator[bytes], timeout: float | None) -> bytes | None:
        sent = _Requests(requests)
        try:
            return self._connection.upload(name, sent, timeout)[0]
        except VoxelpipeError:
            sent.raise_failure()
            raise

    async def wait(self, seconds: float, connected: bool) -> None:
        if connected:
            time.sleep(seconds)
        else:
            self._connection.wait_connected(seconds)

    async def work(self, run: Callable[[], _Result]) -> _Result:
        return run()

    async def result(self, job: Job, timeout: float | None, reporter: Reporter) -> VoxelGrid:
        if not job.in_one_message():
            requests = _Requests(job.upload(reporter))
            call, request_id = self._connection.stream("VoxelizeUpload", requests, timeout)
            requests.call = call
            return self._read(job, call, request_id, reporter, requests)
        request = job.whole(reporter)
        if not job.small_result():
            call, request_id = self._connection.stream("Voxelize", request, timeout)
            return self._read(job, call, request_id, reporter, None)
        responses, request_id = self._connection.responses("Voxelize", request, timeout, _SMALL_RESULT_BYTES)
        reader = self._reader(job, request_id, reporter)
        for response in responses:
            reader.add_bytes(response)
        return reader.finish()

    def _reader(self, job: Job, request_id: str, reporter: Reporter) -> ResultReader:
        return ResultReader(job.request, self._connection.options.max_result_bytes, request_id, reporter)

    def _read(
        self, job: Job, call: Any, request_id: str, reporter: Reporter, requests: "_Requests | None"
    ) -> VoxelGrid:
        reader = self._reader(job, request_id, reporter)
        try:
            with contextlib.closing(received_ahead(call)) as messages:
                for message in messages:
                    reader.add_bytes(message)
        except grpc.RpcError as error:
            if requests is not None:
                requests.raise_failure()
            raise self._connection.error(error, request_id) from None
        if requests is not None:
            requests.raise_failure()
        return reader.finish()


class _Requests:
    """The requests of a call, which a thread of gRPC asks for. An exception ends the call and is kept."""

    def __init__(self, messages: Iterator[bytes]) -> None:
        self._messages = messages
        self._failure: BaseException | None = None
        self.call: Any = None

    def __iter__(self) -> "_Requests":
        return self

    def __next__(self) -> bytes:
        try:
            return next(self._messages)
        except StopIteration:
            raise
        except BaseException as error:
            self._failure = error
            if self.call is not None:
                self.call.cancel()
            raise StopIteration from None

    def raise_failure(self) -> None:
        """Raises the exception of the requests, if there was one."""
        if self._failure is not None:
            raise self._failure
