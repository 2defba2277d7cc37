"""The calls of a server, once for both clients: requests, replies and retries. How to wait is the Transport's."""
from __future__ import annotations

import contextlib
from typing import Any, Awaitable, Callable, Coroutine, Iterator, Protocol, TypeVar

from .._mesh.forms import MeshFile, MeshLike, load_mesh
from .._mesh.placed import Source
from .._proto.voxelpipe.v1 import mesh_pb2, server_info_pb2
from .._proto.voxelpipe.v1 import voxelization_service_pb2 as service
from ..errors import DataLoss, MeshNotFound, NotSupported, VoxelpipeError
from ..grid import VoxelGrid
from ..mesh_handle import MeshHandle, job_of, name_of
from ..options import make_call
from ..report import Estimate, MeshInfo, ServerInfo, ShaderInfo, StoredMesh
from ..request import Call, checked_timeout
from .progress import WAITING, Progress, Reporter
from .retry import Deadline, Retries, ServerState
from .session import Job, Options, freed_bytes, listed_meshes, naming, upload_messages, uploaded
from .wire import parsed

_QUICK_S = 10.0
_MAX_STORED_NAMES = 65_536  # that a client remembers; more are asked for again
_PLACED_REVISION = 2  # of the contract, from which on requests place several meshes
_Result = TypeVar("_Result")


class Transport(Protocol):
    """Makes the attempts of calls, and waits for them: a blocking one, whose coroutines never suspend, or asyncio's."""

    async def unary(self, name: str, request: bytes, timeout: float | None) -> bytes | None:
        """A unary call. Out: None: it ended well, and without any response."""

    async def result(self, job: Job, timeout: float | None, reporter: Reporter) -> VoxelGrid:
        """Voxelize, or VoxelizeUpload of a large mesh."""

    async def upload(self, name: str, requests: Iterator[bytes], timeout: float | None) -> bytes | None:
        """A call with a stream of requests and one response. Out: as of unary."""

    async def wait(self, seconds: float, connected: bool) -> None:
        """Waits at most so long: without a connection until there is one."""

    async def work(self, run: Callable[[], _Result]) -> _Result:
        """What a function returns that takes a while."""


def finished(call: Coroutine[Any, Any, _Result]) -> _Result:
    """What a coroutine returns whose transport is a blocking one."""
    try:
        call.send(None)
    except StopIteration as done:
        result: _Result = done.value
        return result
    raise RuntimeError("a blocking call has suspended")


class ServerCalls:
    """Those of Client and AsyncClient, which describe them."""

    def __init__(self, transport: Transport, options: Options, restarts: bool) -> None:
        self._transport = transport
        self._options = options
        self._state = ServerState(restarts)
        self._stored: set[str] = set()  # names of meshes that the server had when they were last needed
        self._takes_several = False  # once the server has said so: an older one would see a request without a mesh

    async def voxelize(self, mesh: MeshLike | MeshHandle, call: Call) -> VoxelGrid:
        job, file = await self._transport.work(lambda: job_of(mesh, call))
        return await self.run(job, file, timeout=call.timeout, progress=call.progress)

    async def run(self, job: Job, file: MeshFile | None, *, timeout: float | None, progress: Progress) -> VoxelGrid:
        reporter = Reporter(progress)
        deadline = self._deadline(timeout)

        async def voxelized() -> VoxelGrid:
            return await self._again(deadline, lambda left: self._transport.result(job, left, reporter), reporter)

        with contextlib.closing(reporter), naming(file or job.file):
            await self._store_new(job, deadline, reporter)
            try:
                return await voxelized()
            except MeshNotFound:
                if not await self._store_all(job, file, deadline, reporter):
                    raise
            return await voxelized()

    async def _store_new(self, job: Job, deadline: Deadline, reporter: Reporter) -> None:
        """Stores those meshes of several that the server may not have. Errors: NotSupported by an older server."""
        if job.placed is None:
            return
        if not self._takes_several:
            revision = (await self._server_info(deadline, reporter)).contract_revision
            if revision < _PLACED_REVISION:
                raise NotSupported(
                    f"the server at {self._options.server} speaks revision {revision} of the contract; several meshes "
                    f"on one grid need revision {_PLACED_REVISION}"
                )
            self._takes_several = True
        for source in job.placed.sources:
            if not source.kept and source.name not in self._stored:
                await self._store(source, deadline, reporter)

    async def _store_all(self, job: Job, file: MeshFile | None, deadline: Deadline, reporter: Reporter) -> bool:
        """Stores the kept mesh of a job, or its several ones, again. Out: False if no file of them is here."""
        if file is not None:
            await self._upload(file, deadline, reporter)
        here = [source for source in job.placed.sources if source.file] if job.placed is not None else []
        for source in here:
            await self._store(source, deadline, reporter)
        return file is not None or bool(here)

    async def _store(self, source: Source, deadline: Deadline, reporter: Reporter) -> None:
        file = source.named_file
        assert file is not None
        with naming(file):
            await self._upload(file, deadline, reporter, source.name)
        if len(self._stored) >= _MAX_STORED_NAMES:
            self._stored.clear()
        self._stored.add(source.name)

    async def upload(self, mesh: MeshLike, *, keep: bool, timeout: float | None, progress: Progress) -> MeshHandle:
        file = await self._transport.work(lambda: load_mesh(mesh))
        reporter = Reporter(progress)
        with contextlib.closing(reporter), naming(file):
            kept = await self._upload(file, self._deadline(timeout), reporter)
        stored = StoredMesh.of(kept)
        return MeshHandle(stored.name, stored, kept.already_stored, file if keep else None)

    async def stored_mesh(self, mesh: MeshHandle | str) -> StoredMesh:
        answer = await self._quick("GetMesh", mesh_pb2.GetMeshRequest(name=name_of(mesh)))
        return StoredMesh.of(parsed(mesh_pb2.Mesh, answer))

    async def page(self, token: str) -> tuple[list[StoredMesh], str | None]:
        """A page of the kept meshes, and the token of the next one; None: it is the last. In: its own; first empty."""
        return listed_meshes(await self._quick("ListMeshes", mesh_pb2.ListMeshesRequest(page_token=token)), token)

    async def release_mesh(self, mesh: MeshHandle | str) -> int:
        return freed_bytes(await self._quick("ReleaseMesh", mesh_pb2.ReleaseMeshRequest(name=name_of(mesh))))

    async def estimate(self, mesh: MeshLike | MeshHandle, *, timeout: float | None, **options: Any) -> Estimate:
        call = make_call(**options)
        job, _ = await self._transport.work(lambda: job_of(mesh, call))
        message = job.estimate()
        deadline = self._deadline(timeout)

        async def estimated() -> bytes | None:
            return await self._again(
                deadline, lambda left: self._transport.unary("EstimateVoxelization", message, left)
            )

        with contextlib.closing(Reporter(None)) as reporter, naming(job.file):
            await self._store_new(job, deadline, reporter)
            try:
                answer = await estimated()
            except MeshNotFound:
                if not await self._store_all(job, None, deadline, reporter):
                    raise
                answer = await estimated()
        return Estimate.of(parsed(service.EstimateVoxelizationResponse, answer))

    async def mesh_info(self, mesh: MeshLike | MeshHandle, *, timeout: float | None) -> MeshInfo:
        # Of the calls without a result the one that examines a mesh, if it has a fill; its grid is of no interest.
        plan = await self.estimate(mesh, timeout=timeout, resolution=1, fill="parity")
        if plan.mesh is None:
            raise DataLoss("the server's answer: it has no report on the mesh")
        return MeshInfo(plan.mesh, plan.warnings, None)

    async def shaders(self) -> list[ShaderInfo]:
        answer = await self._quick("ListShaders", server_info_pb2.ListShadersRequest())
        return [ShaderInfo.of(shader) for shader in parsed(server_info_pb2.ListShadersResponse, answer).shaders]

    async def server_info(self) -> ServerInfo:
        return await self._server_info(Deadline(_QUICK_S), None)

    async def _server_info(self, deadline: Deadline, reporter: Reporter | None) -> ServerInfo:
        data = server_info_pb2.GetServerInfoRequest().SerializeToString()
        answer = await self._again(deadline, lambda left: self._transport.unary("GetServerInfo", data, left), reporter)
        return ServerInfo.of(parsed(server_info_pb2.GetServerInfoResponse, answer))

    def _deadline(self, timeout: float | None) -> Deadline:
        return Deadline(self._options.timeout if timeout is None else checked_timeout(timeout))

    async def _quick(self, name: str, request: Any) -> bytes | None:
        data = request.SerializeToString()
        return await self._again(Deadline(_QUICK_S), lambda left: self._transport.unary(name, data, left))

    async def _upload(self, file: MeshFile, deadline: Deadline, reporter: Reporter, name: str = "") -> mesh_pb2.Mesh:
        """In: the mesh's name, if it is known."""
        name = name or await self._transport.work(file.stored_name)

        def attempt(left: float | None) -> Awaitable[bytes | None]:
            return self._transport.upload("UploadMesh", upload_messages(file, name, reporter), left)

        kept = uploaded(await self._again(deadline, attempt, reporter), name)
        reporter("upload", 1.0, 0)
        return kept

    async def _again(
        self,
        deadline: Deadline,
        attempt: Callable[[float | None], Awaitable[_Result]],
        reporter: Reporter | None = None,
    ) -> _Result:
        retries = Retries(self._options.retries, deadline, self._state)
        while True:
            try:
                result = await attempt(deadline.left())
                self._state.note(None)
                return result
            except VoxelpipeError as error:
                delay, connected = retries.delay(error), getattr(error, "connected", True)
            if retries.waiting and reporter is not None:
                reporter(WAITING, 0.0, 0)
            await self._transport.wait(delay, connected)
