"""A mesh that a server keeps."""
from __future__ import annotations

import dataclasses
from typing import Any

from ._calls.session import Job, positions_file
from ._mesh.forms import MeshFile, MeshLike, load_mesh
from ._mesh.placed import placed_meshes
from .errors import InvalidRequest
from .report import StoredMesh
from .request import Call


@dataclasses.dataclass(frozen=True)
class MeshHandle:
    """A mesh that a server keeps; give it in place of the mesh. Made by Client.upload().

    name: on the server, see StoredMesh. stored: the server's description. file: sent again if the server, or another
    replica of it, does not have the mesh (any more); None: MeshNotFound is raised then.
    """

    name: str
    stored: StoredMesh
    already_stored: bool
    file: MeshFile | None = dataclasses.field(repr=False)

    def __reduce__(self) -> tuple[Any, ...]:
        file = None if self.file is None else (bytes(self.file.data), self.file.format, self.file.name, self.file.unit)
        return _restored_handle, (self.name, self.stored, self.already_stored, file)


def _restored_handle(
    name: str, stored: StoredMesh, already: bool, file: tuple[bytes, int, str, str] | None
) -> MeshHandle:
    return MeshHandle(name, stored, already, file and MeshFile(memoryview(file[0]), *file[1:]))


def job_of(mesh: MeshLike | MeshHandle, call: Call) -> tuple[Job, MeshFile | None]:
    """The job of a call, and of a kept mesh the file to send if the server does not have it (any more).

    Errors: those of load_mesh() and placed_meshes(); TypeError for new positions of a mesh that is not kept.
    """
    if call.together is not None:
        if call.new_positions is not None:
            raise InvalidRequest("new_positions: cannot be given together with several meshes", field="new_positions")
        return Job(call.request, None, placed=placed_meshes(mesh, call.together, _kept)), None
    if isinstance(mesh, MeshHandle):
        positions = None if call.new_positions is None else positions_file(call.new_positions)
        return Job(call.request, positions, mesh.name), mesh.file
    if call.new_positions is not None:
        raise TypeError("new_positions needs a mesh from upload()")
    return Job(call.request, load_mesh(mesh)), None


def name_of(mesh: MeshHandle | str) -> str:
    """The name of a kept mesh. In: a handle or the name."""
    return mesh if isinstance(mesh, str) else mesh.name


def _kept(mesh: Any) -> tuple[str, MeshFile | None] | None:
    """Of a kept mesh its name, and its file if that is here; None of others."""
    if isinstance(mesh, MeshHandle):
        return mesh.name, mesh.file
    return (mesh.name, None) if isinstance(mesh, StoredMesh) else None
