"""The client of a server for asyncio."""
from __future__ import annotations

import asyncio
import os
from typing import Any, AsyncIterable, AsyncIterator, Iterable

from ._calls import core_module
from ._calls.address import ServerLike
from ._calls.asynchronous import Asynchronous, as_async
from ._calls.many import check_many, unreadable
from ._calls.progress import Progress
from ._calls.server_calls import ServerCalls
from ._calls.session import Options, Tls
from ._calls.threads import ThreadCalls
from ._mesh.forms import MeshLike
from .errors import VoxelpipeError
from .grid import VoxelGrid
from .in_process_client import InProcessClient
from .mesh_handle import MeshHandle
from .options import client_method, make_request
from .report import Estimate, MeshInfo, ServerInfo, ShaderInfo, StoredMesh
from .request import Call

_OF_ONE_CALL = ("new_positions", "timeout", "progress")


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
        options = Options.of(server, token, token_file, tls, timeout, retries, max_result_bytes, plaintext_token)
        self._server = options.server
        self._calls: ServerCalls | ThreadCalls
        if not options.server and core_module.available():
            inside = InProcessClient(timeout=timeout, max_result_bytes=max_result_bytes)
            self._calls = ThreadCalls(inside)
            self._close = self._calls.close
        else:
            if not options.server and core_module.is_lost():
                core_module.needed("AsyncClient without an address")
            transport = Asynchronous(options)
            self._calls = ServerCalls(transport, options, getattr(server, "restarts", True))
            self._close = transport.close

    @property
    def server(self) -> str:
        """The server's address."""
        return self._server

    async def aclose(self) -> None:
        """Ends running calls, which raise Cancelled, and the connection. Later calls raise Cancelled."""
        await self._close()

    async def __aenter__(self) -> "AsyncClient":
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.aclose()

    def __repr__(self) -> str:
        return f"<voxelpipe.AsyncClient of {self.server or 'this process'}>"

    @client_method
    async def voxelize(self, mesh: MeshLike | MeshHandle, call: Call) -> VoxelGrid:
        """Voxelizes one mesh, or several on one grid: see voxelpipe.voxelize() and Client.voxelize()."""
        return await self._calls.voxelize(mesh, call)

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
        in_flight = check_many(meshes, in_flight, errors)
        make_request(**{name: value for name, value in options.items() if name not in _OF_ONE_CALL})
        source = meshes.__aiter__() if isinstance(meshes, AsyncIterable) else as_async(meshes)
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
        return await self._calls.upload(mesh, keep=keep, timeout=timeout, progress=progress)

    async def stored_mesh(self, mesh: MeshHandle | str) -> StoredMesh:
        """The server's description of a kept mesh: see Client.stored_mesh()."""
        return await self._calls.stored_mesh(mesh)

    async def meshes(self) -> AsyncIterator[StoredMesh]:
        """The kept meshes of this caller: see Client.meshes()."""
        token: str | None = ""
        while token is not None:
            listed, token = await self._calls.page(token)
            for mesh in listed:
                yield mesh

    async def release_mesh(self, mesh: MeshHandle | str) -> int:
        """Releases this caller's claim on a mesh: see Client.release_mesh()."""
        return await self._calls.release_mesh(mesh)

    async def estimate(self, mesh: MeshLike | MeshHandle, *, timeout: float | None = None, **options: Any) -> Estimate:
        """The plan of a request, without running it: see Client.estimate()."""
        return await self._calls.estimate(mesh, timeout=timeout, **options)

    async def mesh_info(self, mesh: MeshLike | MeshHandle, *, timeout: float | None = None) -> MeshInfo:
        """Counts, box, faults and health of a mesh: see Client.mesh_info()."""
        return await self._calls.mesh_info(mesh, timeout=timeout)

    async def shaders(self) -> list[ShaderInfo]:
        """Every shader that requests may name, vertex shaders first."""
        return await self._calls.shaders()

    async def server_info(self) -> ServerInfo:
        """Version, backends, devices and limits of the server."""
        return await self._calls.server_info()
