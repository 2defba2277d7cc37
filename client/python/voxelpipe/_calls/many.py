"""Many meshes over one stream, VoxelizeBatch: most of the cost of a small job is the call."""
from __future__ import annotations

import math
import os
import queue
import threading
import time
from typing import TYPE_CHECKING, Any, Iterable, Iterator

from .._mesh.forms import MeshFile, load_mesh
from .._proto.voxelpipe.v1 import voxelization_service_pb2 as service
from ..errors import Cancelled, DataLoss, DeadlineExceeded, InvalidMesh, MeshNotFound, VoxelpipeError
from ..grid import VoxelGrid
from ..mesh_handle import MeshHandle
from ..request import Request, checked_in_flight
from .connection import Connection
from .grpc_module import grpc
from .reader import ResultReader
from .session import Job, named
from .status import of_status
from .wire import parsed

if TYPE_CHECKING:
    from ..client import Client

_ROOM_BYTES = 1 << 16  # of a message, besides its mesh
_MESSAGE_JOBS = 256
_LATE = "not done within the timeout, counted from when the mesh was sent"
_WATCH_S = 0.1  # between two looks for late jobs
_ANSWER_S = 1.0  # in which the server answers that a job is cancelled


class _Clock:
    """Seconds that a run has waited for the server. It stands while the caller works on results or reads meshes."""

    def __init__(self) -> None:
        self._state: tuple[float, float | None] = (0.0, None)  # before it was started, and when it was

    def now(self) -> float:
        """Seconds."""
        before, started = self._state
        return before if started is None else before + time.monotonic() - started

    def start(self) -> None:
        """Goes on."""
        self._state = (self.now(), time.monotonic())

    def stop(self) -> None:
        """Stands."""
        self._state = (self.now(), None)


class _Waiting:
    """A job without a complete answer. late_at: by the run's clock; the job is cancelled then."""

    def __init__(self, job: Job, file: MeshFile | None, reader: ResultReader, late_at: float) -> None:
        self.job = job
        self.file = file
        self.reader = reader
        self.late_at = late_at
        self.cancelled = False


class _Watch:
    """Cancels the late jobs of a stream, and the stream if the server does not answer to that: as a whole it has no
    deadline. BatchJob.timeout would count while the caller works, too.
    """

    def __init__(self, call: Any, requests: "Requests", waiting: dict[int, _Waiting], clock: _Clock) -> None:
        self._call = call
        self._requests = requests
        self._waiting = waiting
        self._clock = clock
        self._ended = threading.Event()
        threading.Thread(target=self._run, daemon=True).start()

    def end(self) -> None:
        """Leaves the stream alone."""
        self._ended.set()

    def _run(self) -> None:
        while not self._ended.wait(_WATCH_S):
            now = self._clock.now()
            late = {number: job for number, job in list(self._waiting.items()) if job.late_at <= now}
            if any(job.late_at + _ANSWER_S <= now for job in late.values()):
                self._call.cancel()
                return
            for number, job in late.items():
                if not job.cancelled:
                    job.cancelled = True
                    self._requests.cancel(number)


class Requests:
    """The messages of the stream, which a thread of gRPC takes. Jobs that wait together share one: a message costs
    more than a small job. In: the largest message.
    """

    def __init__(self, most_bytes: int) -> None:
        self._queue: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._most_bytes = most_bytes

    def put(self, request: bytes | None) -> None:
        """Adds a VoxelizeBatchRequest of one job; None ends the stream."""
        self._queue.put(request)

    def cancel(self, number: int) -> None:
        """Adds that a job is no longer wanted."""
        self._queue.put(service.VoxelizeBatchRequest(cancel=[number]).SerializeToString())

    def __iter__(self) -> Iterator[bytes]:
        first = self._queue.get()
        while first is not None:
            joined, size = [first], len(first)
            first = None
            while len(joined) < _MESSAGE_JOBS:
                try:
                    request = self._queue.get_nowait()
                except queue.Empty:
                    break
                if request is None:
                    yield b"".join(joined)
                    return
                size += len(request)
                if size > self._most_bytes:
                    first = request
                    break
                joined.append(request)
            yield b"".join(joined)
            first = self._queue.get() if first is None else first


class Many:
    """One run of voxelize_many. In: the client, for what the stream cannot do, and its connection."""

    def __init__(
        self,
        client: "Client",
        connection: Connection,
        request: Request,
        in_flight: int,
        keep: bool,
        timeout: float | None,
    ) -> None:
        self._client = client
        self._connection = connection
        self._request = request
        self._in_flight = in_flight
        self._keep = keep
        self._timeout = timeout
        self._waiting: dict[int, _Waiting] = {}
        self._done: dict[int, VoxelGrid | VoxelpipeError] = {}
        self._refused: set[int] = set()  # jobs whose result was refused before its end: more of it may come
        self._call: Any = None
        self._clock = _Clock()
        self._watch: _Watch | None = None
        self._request_id = ""
        self._requests = Requests(0)

    def results(self, meshes: Iterable[Any]) -> Iterator[VoxelGrid | VoxelpipeError]:
        """The results, in the order of the meshes."""
        source = iter(meshes)
        sent = given = 0
        more = True
        try:
            while True:
                # Refilled when half of it is free: jobs that are sent together run and come back together.
                room = sent - given <= self._in_flight // 2
                while room and more and sent - given < self._in_flight:
                    try:
                        mesh = next(source)
                    except StopIteration:
                        more = False
                        break
                    self._send(sent, mesh)
                    more = self._keep or not isinstance(self._done.get(sent), VoxelpipeError)
                    sent += 1
                while given in self._done:
                    result = self._done.pop(given)
                    given += 1
                    if isinstance(result, VoxelpipeError) and not self._keep:
                        raise result
                    yield result
                if given < sent and (not more or sent - given > self._in_flight // 2):
                    self._receive()
                elif not more and given == sent:
                    return
        finally:
            self._end()

    def _send(self, number: int, mesh: Any) -> None:
        try:
            job, file = self._job(mesh)
            if len(job.data) > self._client.max_message_bytes() - _ROOM_BYTES and not job.stored:
                handle = self._client.upload(job.file, timeout=self._timeout)
                job, file = Job(self._request, None, handle.name), job.file
        except VoxelpipeError as error:
            self._done[number] = error
            return
        except OSError as error:
            if not self._keep:
                raise
            self._done[number] = unreadable(error)
            return
        if self._call is None:
            self._open()
        options = self._connection.options
        reader = ResultReader(self._request, options.max_result_bytes, self._request_id, None)
        timeout = options.timeout if self._timeout is None else self._timeout
        late_at = self._clock.now() + (math.inf if timeout is None else timeout)
        self._waiting[number] = _Waiting(job, file, reader, late_at)
        self._requests.put(job.batch_job(number))

    def _job(self, mesh: Any) -> tuple[Job, MeshFile | None]:
        if isinstance(mesh, MeshHandle):
            return Job(self._request, None, mesh.name), mesh.file
        return Job(self._request, load_mesh(mesh)), None

    def _open(self) -> None:
        self._requests = Requests(self._client.max_message_bytes() - _ROOM_BYTES)
        self._call, self._request_id = self._connection.stream("VoxelizeBatch", iter(self._requests), None)
        self._watch = _Watch(self._call, self._requests, self._waiting, self._clock)

    def _end(self) -> None:
        if self._watch is not None:
            self._watch.end()
            self._watch = None
        if self._call is not None:
            self._call.cancel()
            self._requests.put(None)
        self._call = None

    def _receive(self) -> None:
        """Takes one message. If the stream has failed, its jobs are made as single calls, with their retries.

        If a reply belongs to no job, all that wait have that as their error.
        """
        self._clock.start()
        try:
            data = next(self._call)
        except (grpc.RpcError, grpc.FutureCancelledError, StopIteration):
            self._end()
            now = self._clock.now()
            for number in [number for number, job in self._waiting.items() if job.late_at <= now]:
                self._waiting.pop(number)
                self._done[number] = DeadlineExceeded(_LATE, request_id=self._request_id)
            for number in sorted(self._waiting):
                result = self._alone(number)
                if isinstance(result, VoxelpipeError) and not self._keep:
                    self._done.update((other, result) for other in self._waiting)
                    self._waiting.clear()
            return
        finally:
            self._clock.stop()
        try:
            for reply in parsed(service.VoxelizeBatchResponse, data).replies:
                self._take(reply)
        except DataLoss as error:
            self._end()
            self._done.update((number, error) for number in self._waiting)
            self._waiting.clear()

    def _take(self, reply: service.BatchReply) -> None:
        """Errors: DataLoss if the reply belongs to no job; those of the job itself are its result."""
        number = reply.id
        waiting = self._waiting.get(number)
        if waiting is None:
            if number in self._refused:
                return
            raise DataLoss(f"the server's answer: to job {number}, which waits for none", request_id=self._request_id)
        try:
            if reply.HasField("error"):
                error = of_status(reply.error, self._connection.options.server, self._request_id)
                if waiting.cancelled and isinstance(error, Cancelled):
                    raise DeadlineExceeded(_LATE, request_id=self._request_id)
                if error.retryable or isinstance(error, MeshNotFound):
                    self._alone(number)
                    return
                raise error
            waiting.reader.add(reply.response)
            if not waiting.reader.complete:
                return
            self._done[number] = waiting.reader.finish()
        except VoxelpipeError as error:
            self._done[number] = named(error, waiting.file or waiting.job.file)
            if reply.HasField("response") and not reply.response.HasField("summary"):
                self._refused.add(number)
                self._requests.cancel(number)
        self._waiting.pop(number, None)

    def _alone(self, number: int) -> VoxelGrid | VoxelpipeError:
        """Makes a job as a single call, in the time that it has left."""
        waiting = self._waiting.pop(number)
        left = waiting.late_at - self._clock.now()
        try:
            if left <= 0:
                raise DeadlineExceeded(_LATE, request_id=self._request_id)
            timeout = self._timeout if math.isinf(left) else left
            self._done[number] = self._client.run(waiting.job, waiting.file, timeout=timeout)
        except VoxelpipeError as error:
            self._done[number] = error
        return self._done[number]


def check_many(meshes: Any, in_flight: int, errors: str) -> int:
    """The arguments of voxelize_many(). Out: in_flight. Errors: TypeError, ValueError, InvalidRequest."""
    if isinstance(meshes, (str, bytes, os.PathLike)):
        raise TypeError(f"meshes: {meshes!r} is one mesh; give a list, or call voxelize()")
    if errors not in ("raise", "return"):
        raise ValueError(f"errors: '{errors}' is neither raise nor return")
    return checked_in_flight(in_flight)


def unreadable(error: OSError) -> InvalidMesh:
    """The error in the place of the result of a mesh whose file cannot be read; the OSError is its cause."""
    result = InvalidMesh(str(error))
    result.__cause__ = error
    return result
