"""The client of a server for asyncio."""
from __future__ import annotations

import asyncio
import contextlib
import os
import threading
from typing import Any, AsyncIterable, AsyncIterator, Awaitable, Callable, Iterable, Iterator, TypeVar

from ._calls import core_module
from ._calls.address import ServerLike, address_of
from ._calls.grpc_module import grpc
from ._calls.many import unreadable
from ._calls.progress import WAITING, Progress, Reporter
from ._calls.reader import ResultReader
from ._calls.retry import Deadline, Retries, ServerState
from ._calls.session import (
    SERVICE,
    Job,
    Options,
    Tls,
    freed_bytes,
    listed_meshes,
    naming,
    new_request_id,
    upload_messages,
    uploaded,
)
from ._calls.status import of_call, of_cancelled
from ._calls.wire import parsed
from ._mesh.forms import MeshFile, MeshLike, load_mesh
from ._proto.voxelpipe.v1 import mesh_pb2, server_info_pb2
from ._proto.voxelpipe.v1 import voxelization_service_pb2 as service
from .errors import Cancelled, MeshNotFound, ServerFailed, VoxelpipeError
from .grid import VoxelGrid
from .in_process_client import InProcessClient
from .mesh_handle import MeshHandle, estimate_job, job_of, name_of
from .options import client_method, make_request
from .report import Estimate, ServerInfo, ShaderInfo, StoredMesh
from .request import Call, checked_in_flight, checked_timeout

_QUICK_S = 10.0
_OF_ONE_CALL = ("new_positions", "timeout", "progress")
_Result = TypeVar("_Result")
_Item = TypeVar("_Item")


class AsyncClient:
    """Voxelizes on a server, with the methods of Client as coroutines. For one event loop; an async context manager.

    Cancelling the task cancels the call, on the server too.
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
        """The options are those of Client. Without an address and the variable VOXELPIPE_SERVER it runs requests in
        this process if voxelpipe_core is installed: see InProcessClient. Errors: InvalidRequest.
        """
        if not (token or token_file):
            token = os.environ.get("VOXELPIPE_TOKEN", "")
        self._options = Options(
            server=address_of(server) or os.environ.get("VOXELPIPE_SERVER", ""),
            token=token,
            token_file=os.fspath(token_file),
            tls=Tls() if tls is True else tls or None,
            timeout=checked_timeout(timeout),
            retries=retries,
            max_result_bytes=max_result_bytes,
            plaintext_token=plaintext_token,
        )
        self._channel: Any = None
        self._inside: InProcessClient | None = None
        if not self._options.server and core_module.available():
            self._inside = InProcessClient(timeout=timeout, max_result_bytes=max_result_bytes)
        elif not self._options.server and core_module.is_lost():
            core_module.needed("AsyncClient without an address")
        else:
            self._options.check()
        self._state = ServerState(getattr(server, "restarts", True))
        self._closing = asyncio.Event()
        self._calls: set[Any] = set()
        self._jobs: set[threading.Event] = set()  # in this process

    @property
    def server(self) -> str:
        """The server's address."""
        return self._options.server

    async def aclose(self) -> None:
        """Ends running calls, which raise Cancelled, and the connection. Later calls raise Cancelled."""
        self._closing.set()
        for call in list(self._calls):
            call.cancel()
        for job in list(self._jobs):
            job.set()
        if self._channel is not None:
            await self._channel.close()
        self._channel = None
        if self._inside is not None:
            await asyncio.to_thread(self._inside.close)

    async def __aenter__(self) -> "AsyncClient":
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.aclose()

    def __repr__(self) -> str:
        return f"<voxelpipe.AsyncClient of {self.server or 'this process'}>"

    @client_method
    async def voxelize(self, mesh: MeshLike | MeshHandle, call: Call) -> VoxelGrid:
        """Voxelizes one mesh on this server: see voxelpipe.voxelize() and Client.voxelize()."""
        job, kept = await asyncio.to_thread(job_of, mesh, call)
        if self._inside is not None:
            run, timeout = self._inside.run, call.timeout
            return await self._in_thread(call.progress, lambda told: run(job, kept, timeout=timeout, progress=told))
        reporter = Reporter(call.progress)
        deadline = self._deadline(call.timeout)
        with contextlib.closing(reporter), naming(kept or job.file):
            try:
                return await self._again(deadline, lambda left: self._voxelize(job, left, reporter), reporter)
            except MeshNotFound:
                if kept is None:
                    raise
            file = kept
            await self._again(deadline, lambda left: self._upload(file, left, reporter), reporter)
            return await self._again(deadline, lambda left: self._voxelize(job, left, reporter), reporter)

    async def voxelize_many(
        self,
        meshes: Iterable[MeshLike | MeshHandle] | AsyncIterable[MeshLike | MeshHandle],
        *,
        in_flight: int = 16,
        errors: str = "raise",
        **options: Any,
    ) -> AsyncIterator[VoxelGrid | VoxelpipeError]:
        """Voxelizes many meshes with the same options, in_flight at a time. Yields the results in their order.

        meshes: also an async iterable. errors: see Client.voxelize_many(). Each mesh is a call of its own.
        """
        if isinstance(meshes, (str, bytes, os.PathLike)):
            raise TypeError(f"meshes: {meshes!r} is one mesh; give a list, or call voxelize()")
        if errors not in ("raise", "return"):
            raise ValueError(f"errors: '{errors}' is neither raise nor return")
        in_flight = checked_in_flight(in_flight)
        make_request(**{name: value for name, value in options.items() if name not in _OF_ONE_CALL})
        source = meshes.__aiter__() if isinstance(meshes, AsyncIterable) else _as_async(meshes)
        running: list[asyncio.Task[VoxelGrid]] = []
        try:
            more = True
            while more or running:
                while more and len(running) < in_flight:
                    try:
                        running.append(asyncio.ensure_future(self.voxelize(await source.__anext__(), **options)))
                    except StopAsyncIteration:
                        more = False
                if not running:
                    return
                result: VoxelGrid | VoxelpipeError
                try:
                    result = await running[0]
                except (VoxelpipeError, OSError) as error:
                    if errors == "raise":
                        raise
                    result = error if isinstance(error, VoxelpipeError) else unreadable(error)
                running.pop(0)
                yield result
        finally:
            for task in running:
                task.cancel()
            await asyncio.gather(*running, return_exceptions=True)

    async def upload(
        self, mesh: MeshLike, *, keep: bool = True, timeout: float | None = None, progress: Progress = None
    ) -> MeshHandle:
        """Stores a mesh on the server: see Client.upload()."""
        if self._inside is not None:
            load, each = self._inside.upload, timeout
            return await self._in_thread(progress, lambda told: load(mesh, keep=keep, timeout=each, progress=told))
        file = await asyncio.to_thread(load_mesh, mesh)
        reporter = Reporter(progress)
        with contextlib.closing(reporter), naming(file):
            deadline = self._deadline(timeout)
            kept = await self._again(deadline, lambda left: self._upload(file, left, reporter), reporter)
        stored = StoredMesh.of(kept)
        return MeshHandle(stored.name, stored, kept.already_stored, file if keep else None)

    async def stored_mesh(self, mesh: MeshHandle | str) -> StoredMesh:
        """The server's description of a kept mesh: see Client.stored_mesh()."""
        if self._inside is not None:
            stored = self._inside.stored_mesh
            return await self._in_thread(None, lambda _: stored(mesh))
        request = mesh_pb2.GetMeshRequest(name=name_of(mesh))
        return StoredMesh.of(parsed(mesh_pb2.Mesh, await self._quick("GetMesh", request)))

    async def meshes(self) -> AsyncIterator[StoredMesh]:
        """The kept meshes of this caller: see Client.meshes()."""
        if self._inside is not None:
            inside = self._inside
            for mesh in await self._in_thread(None, lambda _: list(inside.meshes())):
                yield mesh
            return
        request: mesh_pb2.ListMeshesRequest | None = mesh_pb2.ListMeshesRequest()
        while request is not None:
            listed, request = listed_meshes(await self._quick("ListMeshes", request), request)
            for mesh in listed:
                yield mesh

    async def release_mesh(self, mesh: MeshHandle | str) -> int:
        """Releases this caller's claim on a mesh: see Client.release_mesh()."""
        if self._inside is not None:
            release = self._inside.release_mesh
            return await self._in_thread(None, lambda _: release(mesh))
        request = mesh_pb2.ReleaseMeshRequest(name=name_of(mesh))
        return freed_bytes(await self._quick("ReleaseMesh", request))

    async def estimate(self, mesh: MeshLike | MeshHandle, *, timeout: float | None = None, **options: Any) -> Estimate:
        """The plan of a request, without running it: see Client.estimate()."""
        if self._inside is not None:
            plan = self._inside.estimate
            return await self._in_thread(None, lambda _: plan(mesh, timeout=timeout, **options))
        job = await asyncio.to_thread(estimate_job, mesh, make_request(**options))
        message = job.estimate()
        with naming(job.file):
            answer = await self._again(
                self._deadline(timeout), lambda left: self._unary("EstimateVoxelization", message, left)
            )
        return Estimate.of(parsed(service.EstimateVoxelizationResponse, answer[0]))

    async def shaders(self) -> list[ShaderInfo]:
        """Every shader that requests may name, vertex shaders first."""
        if self._inside is not None:
            listed = self._inside.shaders
            return await self._in_thread(None, lambda _: listed())
        answer = await self._quick("ListShaders", server_info_pb2.ListShadersRequest())
        return [ShaderInfo.of(shader) for shader in parsed(server_info_pb2.ListShadersResponse, answer).shaders]

    async def server_info(self) -> ServerInfo:
        """Version, backends, devices and limits of the server."""
        if self._inside is not None:
            return self._inside.server_info()
        answer = await self._quick("GetServerInfo", server_info_pb2.GetServerInfoRequest())
        return ServerInfo.of(parsed(server_info_pb2.GetServerInfoResponse, answer))

    # ---- in this process ----

    async def _in_thread(self, progress: Progress, work: Callable[[Progress], _Result]) -> _Result:
        """What work(progress) returns, on another thread. Cancelling the task, or closing the client, ends the job at
        its next progress. Errors: Cancelled after aclose().
        """
        if self._closing.is_set():
            raise Cancelled("the client is closed")
        reporter = Reporter(progress)
        cancelled = threading.Event()

        def told(stage: str, fraction: float, size: int) -> None:
            if cancelled.is_set():
                raise Cancelled("the call was cancelled")
            reporter(stage, fraction, size)

        def run() -> _Result:
            with contextlib.closing(reporter):
                return work(told)

        running = asyncio.ensure_future(asyncio.to_thread(run))
        self._jobs.add(cancelled)
        running.add_done_callback(lambda _: self._jobs.discard(cancelled))
        try:
            return await asyncio.shield(running)
        except asyncio.CancelledError:
            cancelled.set()
            running.add_done_callback(lambda ended: ended.cancelled() or ended.exception())
            raise

    # ---- calls ----

    def _deadline(self, timeout: float | None) -> Deadline:
        return Deadline(self._options.timeout if timeout is None else checked_timeout(timeout))

    async def _again(
        self,
        deadline: Deadline,
        call: Callable[[float | None], Awaitable[_Result]],
        reporter: Reporter | None = None,
    ) -> _Result:
        retries = Retries(self._options.retries, deadline, self._state)
        while True:
            try:
                result = await call(deadline.left())
                self._state.note(None)
                return result
            except VoxelpipeError as error:
                delay = retries.delay(error)
            if retries.waiting and reporter is not None:
                reporter(WAITING, 0.0, 0)
            await self._sleep(delay)

    async def _sleep(self, delay: float) -> None:
        """Errors: Cancelled as soon as the client is closed."""
        try:
            await asyncio.wait_for(self._closing.wait(), delay)
        except asyncio.TimeoutError:
            return
        raise Cancelled("the client is closed")

    async def _quick(self, name: str, request: Any) -> bytes | None:
        data = request.SerializeToString()
        answer = await self._again(Deadline(_QUICK_S), lambda left: self._unary(name, data, left))
        return answer[0]

    def _open(self) -> Any:
        if self._closing.is_set():
            raise Cancelled("the client is closed")
        if self._channel is None:
            settings = self._options.channel_options()
            if self._options.tls is None:
                self._channel = grpc.aio.insecure_channel(self._options.server, settings)
            else:
                credentials = grpc.ssl_channel_credentials(*self._options.tls_files())
                self._channel = grpc.aio.secure_channel(self._options.server, credentials, settings)
        return self._channel

    @contextlib.contextmanager
    def _failures(self, call: Any, request_id: str) -> Iterator[None]:
        """Turns the failure of a call of gRPC into the error of its reason, and ends the call with the context."""
        self._calls.add(call)
        try:
            yield
        except asyncio.CancelledError:
            if self._closing.is_set():
                raise Cancelled("the client is closed", request_id=request_id) from None
            raise
        except grpc.RpcError as error:
            text = error.details() or ""
            code, trailers = error.code().name, error.trailing_metadata()
            if code == "CANCELLED" and not self._closing.is_set():
                raise of_cancelled(text, self._options.server, request_id) from None
            raise of_call(code, text, trailers, self._options.server, request_id) from None
        except KeyError as error:  # grpc.aio looks the code up in a table
            raise ServerFailed(f"the server ended the call with the code {error}", request_id=request_id) from None
        finally:
            self._calls.discard(call)
            call.cancel()  # without effect on a call that has ended

    async def _unary(self, name: str, request: bytes, timeout: float | None) -> tuple[bytes | None, str]:
        request_id = new_request_id()
        metadata = self._options.metadata(request_id)
        call = self._open().unary_unary(SERVICE + name)(request, timeout=timeout, metadata=metadata)
        with self._failures(call, request_id):
            answer = await call
        return answer, request_id

    async def _voxelize(self, job: Job, timeout: float | None, reporter: Reporter) -> VoxelGrid:
        request_id = new_request_id()
        metadata = self._options.metadata(request_id)
        if job.in_one_message():
            method = self._open().unary_stream(SERVICE + "Voxelize")
            call = method(job.whole(reporter), timeout=timeout, metadata=metadata)
        else:
            method = self._open().stream_stream(SERVICE + "VoxelizeUpload")
            call = method(_as_async(job.upload(reporter)), timeout=timeout, metadata=metadata)
        reader = ResultReader(job.request, self._options.max_result_bytes, request_id, reporter)
        with self._failures(call, request_id):
            async for message in call:
                reader.add_bytes(message)
        return reader.finish()

    async def _upload(self, file: MeshFile, timeout: float | None, reporter: Reporter) -> Any:
        request_id = new_request_id()
        metadata = self._options.metadata(request_id)
        name = await asyncio.to_thread(file.stored_name)
        method = self._open().stream_unary(SERVICE + "UploadMesh")
        requests = _as_async(upload_messages(file, name, reporter))
        call = method(requests, timeout=timeout, metadata=metadata)
        with self._failures(call, request_id):
            answer = await call
        return uploaded(answer, name)


async def _as_async(items: Iterable[_Item]) -> AsyncIterator[_Item]:
    for item in items:
        yield item
