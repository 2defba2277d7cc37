"""Many meshes over one stream, VoxelizeMany: most of the cost of a small job is the call."""
from __future__ import annotations

import queue
from typing import TYPE_CHECKING, Any, Iterable, Iterator

from .._mesh.forms import MeshFile, load_mesh
from .._proto.voxelpipe.v1 import voxelization_service_pb2 as service
from ..errors import MeshNotFound, VoxelpipeError
from ..grid import VoxelGrid
from ..request import Request
from .connection import Connection
from .crc32c import crc32c
from .grpc_module import grpc
from .reader import ResultReader
from .session import Job
from .status import of_status

if TYPE_CHECKING:
    from ..client import Client

_ROOM_BYTES = 1 << 16  # of a message, besides its mesh


class _Waiting:
    """A job without a complete answer."""

    def __init__(self, job: Job, file: MeshFile | None, reader: ResultReader) -> None:
        self.job = job
        self.file = file
        self.reader = reader


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
        if in_flight < 1:
            raise ValueError(f"in_flight: {in_flight} is below 1")
        self._client = client
        self._connection = connection
        self._request = request
        self._in_flight = in_flight
        self._keep = keep
        self._timeout = timeout
        self._waiting: dict[int, _Waiting] = {}
        self._done: dict[int, VoxelGrid | VoxelpipeError] = {}
        self._call: Any = None
        self._request_id = ""
        self._queue: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()

    def results(self, meshes: Iterable[Any]) -> Iterator[VoxelGrid | VoxelpipeError]:
        """The results, in the order of the meshes."""
        source = iter(meshes)
        sent = given = 0
        more = True
        try:
            while True:
                while more and sent - given < self._in_flight:
                    try:
                        mesh = next(source)
                    except StopIteration:
                        more = False
                        break
                    self._send(sent, mesh)
                    sent += 1
                while given in self._done:
                    result = self._done.pop(given)
                    given += 1
                    if isinstance(result, VoxelpipeError) and not self._keep:
                        raise result
                    yield result
                if given < sent and given not in self._done and (not more or sent - given >= self._in_flight):
                    self._receive()
                elif not more and given == sent:
                    return
        finally:
            self._end()

    def _send(self, number: int, mesh: Any) -> None:
        try:
            job, file = self._job(mesh)
            if len(job.data) > self._client.max_message_bytes() - _ROOM_BYTES and not job.mesh_id:
                handle = self._client.upload(job.file, timeout=self._timeout)
                job, file = Job(self._request, None, handle.mesh_id), job.file
        except VoxelpipeError as error:
            self._done[number] = error
            return
        if self._call is None:
            self._open()
        limit = self._connection.options.max_result_bytes
        reader = ResultReader(self._request, limit, self._request_id, None)
        self._waiting[number] = _Waiting(job, file, reader)
        data = bytes(job.data)
        message = service.VoxelizeManyRequest(
            id=number, config=job.config(), mesh=data, crc32c=crc32c(data), takes_more=True
        )
        self._queue.put(message.SerializeToString())

    def _job(self, mesh: Any) -> tuple[Job, MeshFile | None]:
        if hasattr(mesh, "mesh_id"):
            return Job(self._request, None, mesh.mesh_id), mesh.file
        return Job(self._request, load_mesh(mesh)), None

    def _open(self) -> None:
        self._queue = queue.SimpleQueue()
        self._call, self._request_id = self._connection.stream("VoxelizeMany", iter(self._queue.get, None), None)

    def _end(self) -> None:
        if self._call is not None:
            self._call.cancel()
            self._queue.put(None)
        self._call = None

    def _receive(self) -> None:
        """Takes one response. If the stream has failed, its jobs are made as single calls, with their retries."""
        try:
            response = service.VoxelizeManyResponse.FromString(next(self._call))
        except (grpc.RpcError, StopIteration):
            self._end()
            for number in sorted(self._waiting):
                self._alone(number)
            return
        for one in [response, *response.more]:
            self._take(one)

    def _take(self, response: Any) -> None:
        number = response.id
        waiting = self._waiting.get(number)
        if waiting is None:
            return
        try:
            which = response.WhichOneof("answer")
            if which == "whole":
                waiting.reader.add_whole(response.whole)
            elif which == "part":
                waiting.reader.add(response.part)
                if response.part.WhichOneof("message") != "summary":
                    return
            elif which == "error":
                error = of_status(response.error, self._connection.options.server, self._request_id)
                if error.retryable or isinstance(error, MeshNotFound):
                    self._alone(number)
                    return
                raise error
            else:
                return
            self._done[number] = waiting.reader.finish()
        except VoxelpipeError as error:
            self._done[number] = error
        self._waiting.pop(number, None)

    def _alone(self, number: int) -> None:
        waiting = self._waiting.pop(number)
        try:
            self._done[number] = self._client.run(waiting.job, waiting.file, timeout=self._timeout)
        except VoxelpipeError as error:
            self._done[number] = error
