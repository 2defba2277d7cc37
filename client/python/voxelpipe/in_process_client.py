"""A client that needs no server."""
from __future__ import annotations

import threading
from typing import Any, Callable, Iterable, Iterator, Sequence

from ._calls import core_module, in_process
from ._calls.many import unreadable
from ._calls.progress import Progress
from ._calls.retry import Deadline
from ._calls.session import Job
from ._calls.wire import parsed
from ._mesh.forms import MeshFile, MeshLike, load_mesh
from ._proto.voxelpipe.v1 import mesh_pb2, request_pb2, server_info_pb2
from .client import Client
from .errors import Cancelled, NotSupported, VoxelpipeError
from .grid import VoxelGrid
from .local_server import LocalServer, local_server
from .mesh_handle import MeshHandle, job_of, name_of
from .options import make_call
from .report import Estimate, MeshInfo, ServerInfo, ShaderInfo, StoredMesh
from .request import Request, checked_timeout

_SMALL_FILE_BYTES, _SMALL_RESULT_BYTES = 4 << 20, 64 << 20


class InProcessClient(Client):
    """Voxelizes in this process, by the package voxelpipe_core, with the methods of Client. Thread-safe.

    default_client() gives one where voxelpipe_core is installed and no server is named. voxelize_many() runs small
    meshes with small results in batches of in_flight, whose timeout is that of the batch, others one after the other.
    upload() loads a mesh that stays in memory until release_mesh() or close(); later calls raise Cancelled. A forked
    child of a process that has run requests or saved files takes a server of its own (local_server()), as the core's
    threads are not in it. Pickles as its options.
    """

    def __init__(
        self, *, timeout: float | None = in_process.DEFAULT_TIMEOUT_S, max_result_bytes: int = in_process.ANY_BYTES
    ) -> None:
        """timeout: seconds of a call; None: 600. max_result_bytes: larger results are refused.

        Errors: MissingPackage without voxelpipe_core.
        """
        core_module.needed("a client without a server")
        self._timeout = checked_timeout(timeout)
        self._max_result_bytes = max_result_bytes
        self._lock = threading.Lock()
        self._held: dict[str, in_process.Held] = {}
        self._loading: dict[str, threading.Lock] = {}
        self._closed = False
        self._server: LocalServer | None = None
        self._forked: Client | None = None

    @property
    def server(self) -> str:
        """Empty: there is none."""
        return ""

    @property
    def closed(self) -> bool:
        """True after close()."""
        return self._closed

    def close(self) -> None:
        """Frees the meshes. Running calls go on; later ones raise Cancelled."""
        with self._lock:
            self._closed = True
            self._held.clear()
            server, self._server, self._forked = self._server, None, None
        if server is not None:
            server.stop()

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (self._timeout, self._max_result_bytes)

    def __repr__(self) -> str:
        return "<voxelpipe client of this process>"

    def run(
        self, job: Job, file: MeshFile | None = None, *, timeout: float | None = None, progress: Progress = None
    ) -> VoxelGrid:
        """Runs a job. In: the file of its kept mesh, loaded if it is not (any more)."""
        forked = self._served()
        if forked is not None:
            return forked.run(job, file, timeout=timeout, progress=progress)
        deadline = Deadline(self._seconds(timeout))
        held = self._held_of(job, file, deadline, progress)
        return in_process.run(job, deadline.left(), progress, held, self._max_result_bytes)

    def upload(
        self, mesh: MeshLike, *, keep: bool = True, timeout: float | None = None, progress: Progress = None
    ) -> MeshHandle:
        """Loads a mesh, which stays in memory; give the handle in place of the mesh.

        keep: the handle holds the file too, for other processes. Errors: as voxelize().
        """
        forked = self._served()
        if forked is not None:
            return forked.upload(mesh, keep=keep, timeout=timeout, progress=progress)
        file = load_mesh(mesh)
        name = file.stored_name()
        held, there = self._load(name, file, timeout, progress)
        return MeshHandle(name, _described(held), there, file if keep else None)

    def stored_mesh(self, mesh: MeshHandle | str) -> StoredMesh:
        """The description of a loaded mesh. In: a handle or a name. Errors: MeshNotFound."""
        forked = self._served()
        if forked is not None:
            return forked.stored_mesh(mesh)
        return _described(self._find(name_of(mesh), None, None, None))

    def meshes(self) -> Iterator[StoredMesh]:
        """The loaded meshes; the newest first."""
        forked = self._served()
        if forked is not None:
            yield from forked.meshes()
            return
        with self._lock:
            loaded = [*self._held.values()]
        yield from map(_described, reversed(loaded))

    def release_mesh(self, mesh: MeshHandle | str) -> int:
        """Frees a loaded mesh, when no call uses it any more. Out: its bytes. Errors: MeshNotFound."""
        forked = self._served()
        if forked is not None:
            return forked.release_mesh(mesh)
        with self._lock:
            held = self._held.pop(name_of(mesh), None)
        if held is None:
            raise in_process.not_found(name_of(mesh))
        return _described(held).memory_bytes

    def estimate(self, mesh: MeshLike | MeshHandle, *, timeout: float | None = None, **options: Any) -> Estimate:
        """The plan of a request - grid, bytes, time class - without running it. options: those of voxelize()."""
        forked = self._served()
        if forked is not None:
            return forked.estimate(mesh, timeout=timeout, **options)
        job, file = job_of(mesh, make_call(**options))
        deadline = Deadline(self._seconds(timeout))
        held = self._held_of(job, file, deadline, None)
        return Estimate.of(in_process.estimate(job, held, deadline.left()))

    def mesh_info(self, mesh: MeshLike | MeshHandle, *, timeout: float | None = None) -> MeshInfo:
        """Counts, box, faults and health of a mesh, as `voxelpipe info` has them. Errors: as voxelize()."""
        forked = self._served()
        if forked is not None:
            return forked.mesh_info(mesh, timeout=timeout)
        if isinstance(mesh, MeshHandle):
            held = self._find(mesh.name, mesh.file, timeout, None)
        else:
            held = in_process.load(load_mesh(mesh), "", self._seconds(timeout), None)
        return in_process.mesh_info(held, self._seconds(timeout))

    def shaders(self) -> list[ShaderInfo]:
        """Every shader that requests may name, vertex shaders first."""
        forked = self._served()
        if forked is not None:
            return forked.shaders()
        listed = server_info_pb2.ListShadersResponse.FromString(core_module.core.shaders())
        return [ShaderInfo.of(shader) for shader in listed.shaders]

    def server_info(self) -> ServerInfo:
        """Errors: NotSupported, as there is no server."""
        raise NotSupported("server_info: there is no server; requests run in this process")

    # ---- many ----

    def _many(
        self, request: Request, in_flight: int, keep: bool, timeout: float | None
    ) -> Callable[[Iterable[Any]], Iterator[VoxelGrid | VoxelpipeError]]:
        def results(meshes: Iterable[Any]) -> Iterator[VoxelGrid | VoxelpipeError]:
            forked = self._served()
            if forked is not None:
                yield from forked._many(request, in_flight, keep, timeout)(meshes)
                return
            source, more = iter(meshes), True
            while more:
                batch: list[Any] = []
                while more and len(batch) < in_flight:
                    try:
                        batch.append(self._opened(next(source), keep, timeout))
                    except StopIteration:
                        more = False
                    except Exception as error:  # of the source, or a mesh that is none: raised after those before it
                        batch.append(_Raised(error))
                        more = False
                yield from self._batch(request, batch, keep, timeout)

        return results

    def _opened(self, mesh: Any, keep: bool, timeout: float | None) -> Any:
        """A file, a held mesh, or the error in the place of the result."""
        try:
            is_handle = isinstance(mesh, MeshHandle)
            return self._find(mesh.name, mesh.file, timeout, None) if is_handle else load_mesh(mesh)
        except VoxelpipeError as error:
            return error
        except OSError as error:
            if not keep:
                raise
            return unreadable(error)

    def _batch(
        self, request: Request, meshes: Sequence[Any], keep: bool, timeout: float | None
    ) -> Iterator[VoxelGrid | VoxelpipeError]:
        small = {number: mesh for number, mesh in enumerate(meshes) if _is_small(request, mesh)}
        seconds, limit = self._seconds(timeout), self._max_result_bytes
        together = dict(zip(small, in_process.run_all(request, [*small.values()], seconds, limit)))
        for number, mesh in enumerate(meshes):
            if isinstance(mesh, _Raised):
                raise mesh.error
            if isinstance(mesh, VoxelpipeError):
                result: VoxelGrid | VoxelpipeError = mesh
            elif number in together:
                result = together.pop(number)
            else:
                result = self._alone(request, mesh, seconds)
            if isinstance(result, VoxelpipeError) and not keep:
                raise result
            yield result

    def _alone(self, request: Request, mesh: Any, seconds: float | None) -> VoxelGrid | VoxelpipeError:
        file = mesh if isinstance(mesh, MeshFile) else None
        held = None if file else mesh
        try:
            return in_process.run(Job(request, file), seconds, None, held, self._max_result_bytes)
        except VoxelpipeError as error:
            return error

    # ---- meshes ----

    def _seconds(self, timeout: float | None) -> float | None:
        return self._timeout if timeout is None else checked_timeout(timeout)

    def _held_of(self, job: Job, file: MeshFile | None, deadline: Deadline, progress: Progress) -> in_process.Held:
        """The held mesh of a job, or the list of its several ones, loaded where they are not; None: its file is given.

        In: the file of its kept mesh. Files of several stay loaded as long as callers keep them.
        """
        if job.placed is None:
            return self._find(job.stored, file, deadline.left(), progress) if job.stored else None
        held, others = [], []
        for source in job.placed.sources:
            if source.kept or source.name in self._held:
                held.append(self._find(source.name, source.named_file, deadline.left(), progress))
            else:
                others.append(source)
        return held + in_process.load_several(others, deadline, progress)

    def _find(
        self, name: str, file: MeshFile | None, timeout: float | None, progress: Progress
    ) -> in_process.Held:
        held = self._held.get(name)
        if held is not None:
            return held
        if file is None:
            raise in_process.not_found(name)
        return self._load(name, file, timeout, progress)[0]

    def _load(
        self, name: str, file: MeshFile, timeout: float | None, progress: Progress
    ) -> tuple[in_process.Held, bool]:
        """The loaded mesh, and True if it was there: of several threads one loads it."""
        with self._lock:
            loading = self._loading.setdefault(name, threading.Lock())
        with loading:
            held = self._held.get(name)
            if held is not None:
                return held, True
            held = in_process.load(file, name, self._seconds(timeout), progress)
            with self._lock:
                self._loading.pop(name, None)
                if not self._closed:
                    self._held[name] = held
            return held, False

    def _served(self) -> Client | None:
        """The client of a server, in a forked child that cannot use the core. Errors: Cancelled after close()."""
        if self._closed:
            raise Cancelled("the client is closed")
        if core_module.available():
            return None
        with self._lock:
            if self._forked is None:
                self._server = start_server()
                self._forked = self._server.client(timeout=self._timeout)
            return self._forked


class _Raised:
    """An exception in the place of a mesh."""

    def __init__(self, error: Exception) -> None:
        self.error = error


def start_server() -> LocalServer:
    """A local server. Errors: those of local_server(); in a forked child MissingPackage, if there is no voxelpiped."""
    try:
        return local_server()
    except FileNotFoundError as error:
        if not core_module.is_lost():
            raise
        try:
            core_module.needed("this process, in which there is no voxelpiped either,")
        except VoxelpipeError as lost:
            raise lost from error
        raise


def _is_small(request: Request, mesh: Any) -> bool:
    """True for jobs that may run together: all of their meshes and results are in memory at the same time."""
    if isinstance(mesh, (VoxelpipeError, _Raised)) or request.spec.result == request_pb2.RESULT_KIND_BUCKETS:
        return False
    file_bytes = len(mesh.data) if isinstance(mesh, MeshFile) else 0
    return file_bytes <= _SMALL_FILE_BYTES and request.dense_bytes() <= _SMALL_RESULT_BYTES


def _described(held: in_process.Held) -> StoredMesh:
    return StoredMesh.of(parsed(mesh_pb2.Mesh, held.describe()))


def _restored(timeout: float | None, max_result_bytes: int) -> InProcessClient:
    return InProcessClient(timeout=timeout, max_result_bytes=max_result_bytes)
