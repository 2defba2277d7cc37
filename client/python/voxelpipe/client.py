"""The client of a server."""
from __future__ import annotations

import dataclasses
import os
from typing import Any, Callable, Iterable, Iterator

from ._calls.address import ServerLike
from ._calls.blocking import Blocking
from ._calls.connection import Connection
from ._calls.many import Many, check_many
from ._calls.progress import Progress
from ._calls.server_calls import ServerCalls, finished
from ._calls.session import SMALL_BYTES, Job, Options, Tls
from ._mesh.forms import MeshFile, MeshLike
from .errors import DataLoss, VoxelpipeError
from .grid import VoxelGrid
from .mesh_handle import MeshHandle, job_of
from .options import client_method, make_request
from .report import Estimate, MeshInfo, ServerInfo, ShaderInfo, StoredMesh
from .request import Call, Request, checked_timeout

_MOST_MESSAGE_BYTES = 1 << 30  # protobuf takes less than 2 GiB


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
        options = Options.of(server, token, token_file, tls, timeout, retries, max_result_bytes, plaintext_token)
        self._connection = Connection(options)
        self._calls = ServerCalls(Blocking(self._connection), options, getattr(server, "restarts", True))
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
        """Voxelizes one mesh, or several on one grid, on this server: see voxelpipe.voxelize() for the options.

        mesh: also a handle from upload(); then new_positions, (n, 3) in world units for the n vertices of the flattened
        mesh (handle.stored.mesh.vertices), replace its own. With together=True the meshes of the list are stored on the
        server first, each that it does not have yet. timeout: seconds; None: the client's.
        """
        job, file = job_of(mesh, call)
        return self.run(job, file, timeout=call.timeout, progress=call.progress)

    def run(
        self, job: Job, file: MeshFile | None = None, *, timeout: float | None = None, progress: Progress = None
    ) -> VoxelGrid:
        """Runs a job, with retries. In: the file of its kept mesh, sent if the server does not have it."""
        return finished(self._calls.run(job, file, timeout=timeout, progress=progress))

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
        in_flight = check_many(meshes, in_flight, errors)
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
        return finished(self._calls.upload(mesh, keep=keep, timeout=timeout, progress=progress))

    def stored_mesh(self, mesh: MeshHandle | str) -> StoredMesh:
        """The server's description of a kept mesh. In: a handle or a name. Errors: MeshNotFound."""
        return finished(self._calls.stored_mesh(mesh))

    def meshes(self) -> Iterator[StoredMesh]:
        """The kept meshes that this caller has sent, an administrator's call all; the newest first."""
        token: str | None = ""
        while token is not None:
            listed, token = finished(self._calls.page(token))
            yield from listed

    def release_mesh(self, mesh: MeshHandle | str) -> int:
        """Releases this caller's claim on a mesh, which is deleted if no other client has one.

        Out: the bytes that the server frees; 0 if it keeps it for others. Errors: MeshNotFound, PermissionDenied
        without a claim.
        """
        return finished(self._calls.release_mesh(mesh))

    # ---- questions ----

    def estimate(self, mesh: MeshLike | MeshHandle, *, timeout: float | None = None, **options: Any) -> Estimate:
        """The plan of a request - grid, bytes, time class - without running it. options: those of voxelize().

        The mesh is sent in one message: of large ones upload() a handle.
        """
        return finished(self._calls.estimate(mesh, timeout=timeout, **options))

    def mesh_info(self, mesh: MeshLike | MeshHandle, *, timeout: float | None = None) -> MeshInfo:
        """Counts, box and faults of a mesh; without a server its health too, as `voxelpipe info` has it.

        The mesh is sent in one message: of large ones upload() a handle. Errors: as voxelize().
        """
        return finished(self._calls.mesh_info(mesh, timeout=timeout))

    def shaders(self) -> list[ShaderInfo]:
        """Every shader that requests may name, vertex shaders first."""
        return finished(self._calls.shaders())

    def server_info(self) -> ServerInfo:
        """Version, backends, devices and limits of the server."""
        return finished(self._calls.server_info())

    def max_message_bytes(self) -> int:
        """Of one request message; asked for once. Errors: DataLoss if no job fits into one."""
        if not self._max_message_bytes:
            most_bytes = self.server_info().limits["max_message_bytes"]
            if most_bytes < SMALL_BYTES:
                raise DataLoss(f"the server's answer: messages of at most {most_bytes} bytes")
            self._max_message_bytes = min(most_bytes, _MOST_MESSAGE_BYTES)
        return self._max_message_bytes


def _restored_client(kind: type[Client], options: Options) -> Client:
    fields = {field.name: getattr(options, field.name) for field in dataclasses.fields(options)}
    fields["tls"] = fields["tls"] or False
    return kind(**fields)
