"""A client that needs no server."""
from __future__ import annotations

import itertools
import threading
from typing import Any, Callable, Iterable, Iterator, Sequence

from ._calls import core_module, in_process
from ._calls.many import unreadable
from ._calls.progress import Progress
from ._calls.session import Job
from ._calls.wire import parsed
from ._mesh.forms import MeshFile, MeshLike, load_mesh
from ._proto.voxelpipe.v1 import types_pb2 as types
from ._proto.voxelpipe.v1 import voxelization_service_pb2 as service
from .client import Client
from .errors import MeshNotFound, NotSupported, VoxelpipeError
from .grid import VoxelGrid
from .local_server import LocalServer, local_server
from .mesh_handle import MeshHandle
from .options import make_request
from .report import Estimate, ServerInfo, ShaderInfo, StoredMesh
from .request import Request, checked_timeout


_SMALL_FILE_BYTES, _SMALL_RESULT_BYTES = 4 << 20, 64 << 20


class InProcessClient(Client):
    """Voxelizes in this process, by the package voxelpipe_core, with the methods of Client. Thread-safe.

    default_client() gives one where voxelpipe_core is installed and no server is named. voxelize_many() runs small
    meshes with small results in batches, others one after the other. upload() loads a mesh that
    stays in memory until delete_mesh() or close(). A forked child of a process that has run requests takes a server of
    its own (local_server()), as the core's threads are not in it. Pickles as its timeout.
    """

    def __init__(self, *, timeout: float | None = in_process.DEFAULT_TIMEOUT_S) -> None:
        """timeout: seconds of a call; None: 600. Errors: MissingPackage without voxelpipe_core."""
        core_module.needed("a client without a server")
        self._timeout = checked_timeout(timeout)
        self._lock = threading.Lock()
        self._held: dict[str, in_process.Held] = {}
        self._server: LocalServer | None = None
        self._forked: Client | None = None

    @property
    def server(self) -> str:
        """Empty: there is none."""
        return ""

    def close(self) -> None:
        """Frees the meshes."""
        with self._lock:
            self._held.clear()
            server, self._server, self._forked = self._server, None, None
        if server is not None:
            server.stop()

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (self._timeout,)

    def __repr__(self) -> str:
        return "<voxelpipe client of this process>"

    def run(
        self, job: Job, file: MeshFile | None = None, *, timeout: float | None = None, progress: Progress = None
    ) -> VoxelGrid:
        """Runs a job. In: the file of its kept mesh, loaded if it is not (any more)."""
        if not core_module.available():
            return self._served().run(job, file, timeout=timeout, progress=progress)
        held = self._find(job.mesh_id, file) if job.mesh_id else None
        return in_process.run(job, self._seconds(timeout), progress, held)

    def upload(
        self, mesh: MeshLike, *, keep: bool = True, timeout: float | None = None, progress: Progress = None
    ) -> MeshHandle:
        """Loads a mesh, which stays in memory; give the handle in place of the mesh.

        keep: the handle holds the file too, for other processes. Errors: as voxelize().
        """
        if not core_module.available():
            return self._served().upload(mesh, keep=keep, timeout=timeout, progress=progress)
        file = load_mesh(mesh)
        mesh_id = file.mesh_id()
        there = self._held.get(mesh_id)
        held = there or in_process.load(file, mesh_id, self._seconds(timeout), progress)
        with self._lock:
            held = self._held.setdefault(mesh_id, held)
        return MeshHandle(mesh_id, _described(held), there is not None, file if keep else None)

    def stored_mesh(self, mesh: MeshHandle | str) -> StoredMesh:
        """The description of a loaded mesh. In: a handle or an id. Errors: MeshNotFound."""
        if not core_module.available():
            return self._served().stored_mesh(mesh)
        return _described(self._find(mesh if isinstance(mesh, str) else mesh.mesh_id, None))

    def delete_mesh(self, mesh: MeshHandle | str) -> int:
        """Frees a loaded mesh. Out: its bytes. Errors: MeshNotFound."""
        if not core_module.available():
            return self._served().delete_mesh(mesh)
        mesh_id = mesh if isinstance(mesh, str) else mesh.mesh_id
        described = _described(self._find(mesh_id, None))
        with self._lock:
            self._held.pop(mesh_id, None)
        return described.memory_bytes

    def estimate(self, mesh: MeshLike | MeshHandle, *, timeout: float | None = None, **options: Any) -> Estimate:
        """The plan of a request - grid, bytes, time class - without running it. options: those of voxelize()."""
        if not core_module.available():
            return self._served().estimate(mesh, timeout=timeout, **options)
        request = make_request(**options)
        file = None if isinstance(mesh, MeshHandle) else load_mesh(mesh)
        held = self._find(mesh.mesh_id, mesh.file) if isinstance(mesh, MeshHandle) else None
        return Estimate.of(in_process.estimate(request, file, held, self._seconds(timeout)))

    def shaders(self) -> list[ShaderInfo]:
        """Every shader that requests may name, vertex shaders first."""
        if not core_module.available():
            return self._served().shaders()
        listed = service.ListShadersResponse.FromString(core_module.core.shaders())
        return [ShaderInfo.of(shader) for shader in listed.shaders]

    def server_info(self) -> ServerInfo:
        """Errors: NotSupported, as there is no server."""
        raise NotSupported("server_info: there is no server; requests run in this process")

    def _many(
        self, request: Request, in_flight: int, keep: bool, timeout: float | None
    ) -> Callable[[Iterable[Any]], Iterator[VoxelGrid | VoxelpipeError]]:
        if not core_module.available():
            return self._served()._many(request, in_flight, keep, timeout)

        def results(meshes: Iterable[Any]) -> Iterator[VoxelGrid | VoxelpipeError]:
            source = iter(meshes)
            while batch := list(itertools.islice(source, in_flight)):
                yield from self._batch(request, batch, keep, timeout)

        return results

    def _batch(
        self, request: Request, meshes: Sequence[Any], keep: bool, timeout: float | None
    ) -> Iterator[VoxelGrid | VoxelpipeError]:
        opened: list[Any] = []
        for mesh in meshes:
            try:
                is_handle = isinstance(mesh, MeshHandle)
                opened.append(self._find(mesh.mesh_id, mesh.file) if is_handle else load_mesh(mesh))
            except VoxelpipeError as error:
                opened.append(error)
            except OSError as error:
                if not keep:
                    raise
                opened.append(unreadable(error))
        small = {n: mesh for n, mesh in enumerate(opened) if _is_small(request, mesh)}
        together = dict(zip(small, in_process.run_all(request, [*small.values()], self._seconds(timeout))))
        for number, mesh in enumerate(opened):
            if isinstance(mesh, VoxelpipeError):
                result: VoxelGrid | VoxelpipeError = mesh
            elif number in together:
                result = together.pop(number)
            else:
                result = self._alone(request, mesh, timeout)
            if isinstance(result, VoxelpipeError) and not keep:
                raise result
            yield result

    def _alone(self, request: Request, mesh: Any, timeout: float | None) -> VoxelGrid | VoxelpipeError:
        file = mesh if isinstance(mesh, MeshFile) else None
        try:
            return in_process.run(Job(request, file), self._seconds(timeout), None, None if file else mesh)
        except VoxelpipeError as error:
            return error

    def _seconds(self, timeout: float | None) -> float | None:
        return self._timeout if timeout is None else checked_timeout(timeout)

    def _find(self, mesh_id: str, file: MeshFile | None) -> in_process.Held:
        held = self._held.get(mesh_id)
        if held is not None:
            return held
        if file is None:
            raise MeshNotFound(f"the mesh {mesh_id} is not loaded in this process", mesh_id=mesh_id)
        held = in_process.load(file, mesh_id, self._timeout, None)
        with self._lock:
            return self._held.setdefault(mesh_id, held)

    def _served(self) -> Client:
        with self._lock:
            if self._forked is None:
                self._server = local_server()
                self._forked = self._server.client(timeout=self._timeout)
            return self._forked


def _is_small(request: Request, mesh: Any) -> bool:
    """True for jobs that may run together: all of their meshes and results are in memory at the same time."""
    if isinstance(mesh, VoxelpipeError) or request.config.result == types.RESULT_KIND_BUCKETS:
        return False
    file_bytes = len(mesh.data) if isinstance(mesh, MeshFile) else 0
    return file_bytes <= _SMALL_FILE_BYTES and request.dense_bytes() <= _SMALL_RESULT_BYTES


def _described(held: in_process.Held) -> StoredMesh:
    return StoredMesh.of(parsed(service.StoredMesh, held.describe()))


def _restored(timeout: float | None) -> InProcessClient:
    return InProcessClient(timeout=timeout)
