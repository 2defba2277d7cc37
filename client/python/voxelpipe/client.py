"""The client of a server."""
from __future__ import annotations

import contextlib
import dataclasses
import os
import time
from typing import Any, Callable, Iterable, Iterator, TypeVar

from ._calls.address import ServerLike, address_of
from ._calls.ahead import received_ahead
from ._calls.connection import Connection
from ._calls.grpc_module import grpc
from ._calls.many import Many
from ._calls.progress import WAITING, Progress, Reporter
from ._calls.reader import ResultReader
from ._calls.retry import Deadline, Retries, ServerState
from ._calls.session import (
    SMALL_BYTES,
    Job,
    Options,
    Tls,
    freed_bytes,
    listed_meshes,
    naming,
    upload_messages,
    uploaded,
)
from ._calls.wire import parsed
from ._mesh.forms import MeshFile, MeshLike, load_mesh
from ._proto.voxelpipe.v1 import mesh_pb2, server_info_pb2
from ._proto.voxelpipe.v1 import voxelization_service_pb2 as service
from .errors import DataLoss, MeshNotFound, VoxelpipeError
from .grid import VoxelGrid
from .mesh_handle import MeshHandle, estimate_job, job_of, name_of
from .options import client_method, make_request
from .report import Estimate, ServerInfo, ShaderInfo, StoredMesh
from .request import Call, Request, checked_in_flight, checked_timeout

_QUICK_S = 10.0
_MOST_MESSAGE_BYTES = 1 << 30  # protobuf takes less than 2 GiB
_SMALL_RESULT_BYTES = 4 * SMALL_BYTES  # of all messages of a result that fits into one, with those of progress
_Result = TypeVar("_Result")


class Client:
    """Voxelizes on a server. Thread-safe; a context manager; pickles as its options, without its connection.

    After a fork the child opens a connection of its own. Calls raise the classes of voxelpipe.errors; Ctrl-C cancels
    the running call, on the server too.
    """

    def __init__(
        self,
        server: ServerLike = "",
        *,
        token: str = "",
        token_file: "str | os.PathLike[str]" = "",
        tls: Tls | bool = False,
        timeout: float | None = 600.0,
        retries: int = 2,
        max_result_bytes: int = 64 << 30,
        plaintext_token: bool = False,
    ) -> None:
        """Connects when the first call is made.

        server: "HOST:PORT", "unix:/PATH" or a LocalServer; empty: the variable VOXELPIPE_SERVER. token, or token_file,
        which is read for each call: sent as a bearer token; empty: the variable VOXELPIPE_TOKEN. Without TLS they go to
        this machine only, unless plaintext_token. tls: True for the system's certificates. timeout: seconds of a call,
        its retries included; None: no limit. retries: how often a call is made again if the server is busy or the
        connection is lost: after the delay that it asks for, else after up to 5 s. A server that has answered this
        client and cannot be reached is asked again until the timeout, as it may restart; not with retries=0 or without
        a timeout, and not by further calls once one has waited in vain.
        max_result_bytes: results that take more memory here are refused; bits that do not stay packed take a byte each.
        Errors: InvalidRequest.
        """
        if not (token or token_file):
            token = os.environ.get("VOXELPIPE_TOKEN", "")
        self._connection = Connection(
            Options(
                server=address_of(server) or os.environ.get("VOXELPIPE_SERVER", ""),
                token=token,
                token_file=os.fspath(token_file),
                tls=Tls() if tls is True else tls or None,
                timeout=checked_timeout(timeout),
                retries=retries,
                max_result_bytes=max_result_bytes,
                plaintext_token=plaintext_token,
            )
        )
        self._state = ServerState(getattr(server, "restarts", True))
        self._max_message_bytes = 0

    # ---- life ----

    @property
    def server(self) -> str:
        """The server's address."""
        return self._connection.options.server

    @property
    def closed(self) -> bool:
        """True after close()."""
        return self._connection.closed

    def close(self) -> None:
        """Ends running calls; later ones raise Cancelled."""
        self._connection.close()

    def __enter__(self) -> "Client":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored_client, (type(self), self._connection.options)

    def __repr__(self) -> str:
        return f"<voxelpipe.Client of {self.server}>"

    # ---- voxelize ----

    @client_method
    def voxelize(self, mesh: MeshLike | MeshHandle, call: Call) -> VoxelGrid:
        """Voxelizes one mesh on this server: see voxelpipe.voxelize() for the options.

        mesh: also a handle from upload(); then new_positions, (n, 3) in world units for the n vertices of the flattened
        mesh (handle.stored.mesh.vertices), replace its own. timeout: seconds; None: the client's.
        """
        job, file = job_of(mesh, call)
        return self.run(job, file, timeout=call.timeout, progress=call.progress)

    def run(
        self, job: Job, file: MeshFile | None = None, *, timeout: float | None = None, progress: Progress = None
    ) -> VoxelGrid:
        """Runs a job, with retries. In: the file of its kept mesh, sent if the server does not have it."""
        reporter = Reporter(progress)
        deadline = self._deadline(timeout)
        with contextlib.closing(reporter), naming(file or job.file):
            try:
                return self._again(deadline, lambda left: self._voxelize(job, left, reporter), reporter)
            except MeshNotFound:
                if file is None:
                    raise
            self._again(deadline, lambda left: self._upload(file, left, reporter), reporter)
            return self._again(deadline, lambda left: self._voxelize(job, left, reporter), reporter)

    def voxelize_many(
        self,
        meshes: Iterable[MeshLike | MeshHandle],
        *,
        in_flight: int = 16,
        errors: str = "raise",
        **options: Any,
    ) -> Iterator[VoxelGrid | VoxelpipeError]:
        """Voxelizes many meshes with the same options, over one stream. Yields the results in the order of the meshes.

        meshes: an iterable, read as far ahead as in_flight, the largest number of meshes and results in memory.
        options: those of voxelize(); timeout: seconds of waiting for each mesh, from when it is sent. errors: "raise"
        ends at the first mesh that fails; "return" yields its error in the place of its result, of a file that cannot
        be read InvalidMesh with the OSError as its cause. Busy servers and lost connections are tried again.
        """
        if isinstance(meshes, (str, bytes, os.PathLike)):
            raise TypeError(f"meshes: {meshes!r} is one mesh; give a list, or call voxelize()")
        if errors not in ("raise", "return"):
            raise ValueError(f"errors: '{errors}' is neither raise nor return")
        in_flight = checked_in_flight(in_flight)
        timeout = checked_timeout(options.pop("timeout", None))
        request = make_request(**options)
        return self._many(request, in_flight, errors == "return", timeout)(meshes)

    def _many(
        self, request: Request, in_flight: int, keep: bool, timeout: float | None
    ) -> Callable[[Iterable[Any]], Iterator[VoxelGrid | VoxelpipeError]]:
        return Many(self, self._connection, request, in_flight, keep, timeout).results

    # ---- meshes ----

    def upload(
        self, mesh: MeshLike, *, keep: bool = True, timeout: float | None = None, progress: Progress = None
    ) -> MeshHandle:
        """Stores a mesh on the server, unless it has it already; give the handle in place of the mesh.

        The server keeps it until it is deleted or evicted as least recently used. keep: the handle holds the file, so
        that it can be sent again. Errors: as voxelize(); TooLarge if it is larger than the server's store.
        """
        file = load_mesh(mesh)
        reporter = Reporter(progress)
        with contextlib.closing(reporter), naming(file):
            kept = self._again(self._deadline(timeout), lambda left: self._upload(file, left, reporter), reporter)
        stored = StoredMesh.of(kept)
        return MeshHandle(stored.name, stored, kept.already_stored, file if keep else None)

    def stored_mesh(self, mesh: MeshHandle | str) -> StoredMesh:
        """The server's description of a kept mesh. In: a handle or a name. Errors: MeshNotFound."""
        request = mesh_pb2.GetMeshRequest(name=name_of(mesh))
        return StoredMesh.of(parsed(mesh_pb2.Mesh, self._quick("GetMesh", request)))

    def meshes(self) -> Iterator[StoredMesh]:
        """The kept meshes that this caller has sent, an administrator's call all; the newest first."""
        request: mesh_pb2.ListMeshesRequest | None = mesh_pb2.ListMeshesRequest()
        while request is not None:
            listed, request = listed_meshes(self._quick("ListMeshes", request), request)
            yield from listed

    def release_mesh(self, mesh: MeshHandle | str) -> int:
        """Releases this caller's claim on a mesh, which is deleted if no other client has one.

        Out: the bytes that the server frees; 0 if it keeps it for others. Errors: MeshNotFound, PermissionDenied
        without a claim.
        """
        request = mesh_pb2.ReleaseMeshRequest(name=name_of(mesh))
        return freed_bytes(self._quick("ReleaseMesh", request))

    # ---- questions ----

    def estimate(self, mesh: MeshLike | MeshHandle, *, timeout: float | None = None, **options: Any) -> Estimate:
        """The plan of a request - grid, bytes, time class - without running it. options: those of voxelize().

        The mesh is sent in one message: of large ones upload() a handle.
        """
        job = estimate_job(mesh, make_request(**options))
        message = job.estimate()
        with naming(job.file):
            answer = self._again(
                self._deadline(timeout), lambda left: self._connection.unary("EstimateVoxelization", message, left)[0]
            )
        return Estimate.of(parsed(service.EstimateVoxelizationResponse, answer))

    def shaders(self) -> list[ShaderInfo]:
        """Every shader that requests may name, vertex shaders first."""
        answer = self._quick("ListShaders", server_info_pb2.ListShadersRequest())
        return [ShaderInfo.of(shader) for shader in parsed(server_info_pb2.ListShadersResponse, answer).shaders]

    def server_info(self) -> ServerInfo:
        """Version, backends, devices and limits of the server."""
        answer = self._quick("GetServerInfo", server_info_pb2.GetServerInfoRequest())
        return ServerInfo.of(parsed(server_info_pb2.GetServerInfoResponse, answer))

    # ---- calls ----

    def max_message_bytes(self) -> int:
        """Of one request message; asked for once. Errors: DataLoss if no job fits into one."""
        if not self._max_message_bytes:
            most_bytes = self.server_info().limits["max_message_bytes"]
            if most_bytes < SMALL_BYTES:
                raise DataLoss(f"the server's answer: messages of at most {most_bytes} bytes")
            self._max_message_bytes = min(most_bytes, _MOST_MESSAGE_BYTES)
        return self._max_message_bytes

    def _deadline(self, timeout: float | None) -> Deadline:
        return Deadline(self._connection.options.timeout if timeout is None else checked_timeout(timeout))

    def _quick(self, name: str, request: Any) -> bytes | None:
        data = request.SerializeToString()
        return self._again(Deadline(_QUICK_S), lambda left: self._connection.unary(name, data, left)[0])

    def _again(
        self, deadline: Deadline, call: Callable[[float | None], _Result], reporter: Reporter | None = None
    ) -> _Result:
        retries = Retries(self._connection.options.retries, deadline, self._state)
        while True:
            try:
                result = call(deadline.left())
                self._state.note(None)
                return result
            except VoxelpipeError as error:
                delay, connected = retries.delay(error), getattr(error, "connected", True)
            if retries.waiting and reporter is not None:
                reporter(WAITING, 0.0, 0)
            if connected:
                time.sleep(delay)
            else:
                self._connection.wait_connected(delay)

    def _reader(self, request: Request, request_id: str, reporter: Reporter) -> ResultReader:
        return ResultReader(request, self._connection.options.max_result_bytes, request_id, reporter)

    def _voxelize(self, job: Job, timeout: float | None, reporter: Reporter) -> VoxelGrid:
        if not job.in_one_message():
            upload = _Upload(job.upload(reporter))
            call, request_id = self._connection.stream("VoxelizeUpload", upload, timeout)
            upload.call = call
            return self._read(job, call, request_id, reporter, upload)
        request = job.whole(reporter)
        if not job.small_result():
            call, request_id = self._connection.stream("Voxelize", request, timeout)
            return self._read(job, call, request_id, reporter, None)
        responses, request_id = self._connection.responses("Voxelize", request, timeout, _SMALL_RESULT_BYTES)
        reader = self._reader(job.request, request_id, reporter)
        for response in responses:
            reader.add_bytes(response)
        return reader.finish()

    def _read(
        self, job: Job, call: Any, request_id: str, reporter: Reporter, upload: "_Upload | None"
    ) -> VoxelGrid:
        reader = self._reader(job.request, request_id, reporter)
        try:
            with contextlib.closing(received_ahead(call)) as messages:
                for message in messages:
                    reader.add_bytes(message)
        except grpc.RpcError as error:
            if upload is not None:
                upload.raise_failure()
            raise self._connection.error(error, request_id) from None
        if upload is not None:
            upload.raise_failure()
        return reader.finish()

    def _upload(self, file: MeshFile | None, timeout: float | None, reporter: Reporter) -> mesh_pb2.Mesh:
        assert file is not None
        name = file.stored_name()
        upload = _Upload(upload_messages(file, name, reporter))
        try:
            answer, _ = self._connection.upload("UploadMesh", upload, timeout)
        except VoxelpipeError:
            upload.raise_failure()
            raise
        kept = uploaded(answer, name)
        reporter("upload", 1.0, 0)
        return kept


class _Upload:
    """The requests of a call, which a thread of gRPC asks for. An exception ends the call and is kept."""

    def __init__(self, messages: Iterator[bytes]) -> None:
        self._messages = messages
        self._failure: BaseException | None = None
        self.call: Any = None

    def __iter__(self) -> "_Upload":
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


def _restored_client(kind: type[Client], options: Options) -> Client:
    fields = {field.name: getattr(options, field.name) for field in dataclasses.fields(options)}
    fields["tls"] = fields["tls"] or False
    return kind(**fields)
