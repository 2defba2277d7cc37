"""The calls of a client of this process for AsyncClient: each runs on a thread."""
from __future__ import annotations

import asyncio
import contextlib
import threading
from typing import TYPE_CHECKING, Any, Awaitable, Callable, TypeVar

from .._mesh.forms import MeshLike
from ..errors import Cancelled
from ..grid import VoxelGrid
from ..mesh_handle import MeshHandle, job_of
from ..report import StoredMesh
from ..request import Call
from .progress import Progress, Reporter

if TYPE_CHECKING:
    from ..in_process_client import InProcessClient

_Result = TypeVar("_Result")


class ThreadCalls:
    """The calls of ServerCalls, by those of the client."""

    def __init__(self, client: "InProcessClient") -> None:
        self._client = client
        self._closed = False
        self._jobs: set[threading.Event] = set()

    async def close(self) -> None:
        """Ends running jobs at their next progress. Later calls raise Cancelled."""
        self._closed = True
        for job in list(self._jobs):
            job.set()
        await asyncio.to_thread(self._client.close)

    async def voxelize(self, mesh: MeshLike | MeshHandle, call: Call) -> VoxelGrid:
        def run(told: Progress) -> VoxelGrid:
            job, file = job_of(mesh, call)
            return self._client.run(job, file, timeout=call.timeout, progress=told)

        return await self._run(run, call.progress)

    async def page(self, _: str) -> tuple[list[StoredMesh], None]:
        return await self._run(lambda _: list(self._client.meshes())), None

    def __getattr__(self, name: str) -> Callable[..., Awaitable[Any]]:
        method = getattr(self._client, name)

        async def call(*given: Any, **options: Any) -> Any:
            if "progress" not in options:
                return await self._run(lambda _: method(*given, **options))
            return await self._run(lambda told: method(*given, **{**options, "progress": told}), options["progress"])

        return call

    async def _run(self, work: Callable[[Progress], _Result], progress: Progress = None) -> _Result:
        """What work(progress) returns. Cancelling the task ends the job at its next progress."""
        if self._closed:
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
