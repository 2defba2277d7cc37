"""voxelize() without a client of one's own: in this process or by a server."""
from __future__ import annotations

import os
import threading
from typing import Any, Iterable, Iterator

from ._calls import core_module, in_process
from ._calls.address import ServerLike, address_of
from ._calls.progress import Progress
from ._calls.session import Job
from ._mesh.forms import MeshLike, load_mesh
from .client import Client
from .device import DeviceGrid
from .errors import VoxelpipeError
from .grid import VoxelGrid
from .in_process_client import InProcessClient, start_server
from .local_server import LocalServer
from .mesh_handle import MeshHandle, job_of
from .options import make_call, with_options
from .report import MeshInfo
from .request import Call, checked_timeout

_lock = threading.Lock()
_clients: dict[str, Client] = {}
_server: LocalServer | None = None


def _reset_lock() -> None:
    global _lock
    _lock = threading.Lock()


os.register_at_fork(after_in_child=_reset_lock)


def default_client(server: ServerLike = "") -> Client:
    """The client that voxelize() uses for an address; it is shared and stays open.

    server: empty: the variable VOXELPIPE_SERVER, else this process if voxelpipe_core is installed, else a local server
    that is started once for this process.
    """
    global _server
    with _lock:
        address = address_of(server) or os.environ.get("VOXELPIPE_SERVER", "")
        for gone in [key for key, client in _clients.items() if client.closed]:
            del _clients[gone]  # by a caller
        if not address and "" not in _clients and core_module.available():
            _clients[""] = InProcessClient()
        if not address and "" in _clients:
            return _clients[""]
        if not address:
            if _server is not None and not _server.is_running():
                dead = _clients.pop(_server.server, None)
                if dead is not None:
                    dead.close()
                _server.stop()
                _server = None
            _server = _server or start_server()
            server = _server
            address = server.server
        if address not in _clients:
            _clients[address] = Client(server or address)
        return _clients[address]


@with_options
def voxelize(mesh: MeshLike | MeshHandle, call: Call) -> VoxelGrid:
    """Voxelizes one mesh, or several on one grid.

        r = voxelpipe.voxelize("car.glb", resolution=256, color="base_color:srgb8", normal="normal:f32")
        r.mask, r.color, r.normal    # (nz, ny, nx) bool, (nz, ny, nx, 4) uint8, (nz, ny, nx, 3) float32
        r.world(r.occupied())        # where the occupied voxels' centres lie

    mesh: a path (.glb, .gltf with its files, .drc, .stl, .ply, .off, .obj with its materials, .3mf), the bytes of such
        a file, a binary file object, (vertices, faces), voxelpipe.Mesh, what load_mesh returns, or an object of
        trimesh, Open3D, meshio or VTK, or with `vertices` and `faces`. With together=True a list of such meshes, and
        of handles from upload(); the same one may stand in it several times.
    together: all meshes of the list on one grid, as if they were one mesh. Each option is a list, one for each mesh,
        None: the default. transforms: 4x4 matrices M, p becomes M p, in 4 rows or 16 numbers row by row (None: the mesh
        stays where it is). names: default: the file's, with its extension, or the id of a stored mesh. labels: whole
        numbers from 1 (its number in the list). priorities: whole numbers (0). motions: Motion objects, or mappings
        with linear, angular, center (None: it does not move); the shader `velocity` gives them.

    The grid, one of five: resolution, voxels along the longest extent (default 128); voxel_size, world units, one
        number or x, y, z; dims (x, y, z), cubic voxels in which the mesh is centred; voxel_size, dims and origin (the
        corner of voxel (0, 0, 0)); like, another result's grid. fit: "cube": resolution voxels along every
        axis. padding: voxels added on every side. clip: a box that the grid covers in place of the mesh's, by its
        resolution, voxel_size or dims: "x0,y0,z0,x1,y1,z1", six numbers or two corners, as another result's bounds.
    axes: the mesh's axes that become the grid's, after the vertex shader: "x,z,-y" turns a mesh with z up.

    coverage: which voxels a triangle covers: "conservative" all that it touches, "thin" a 6-separating shell, "center"
        those whose centre it passes, "none" none (with a fill by crossings: the voxels whose centre is inside).
    fill: the inside: "parity" by crossings along x, "nonzero" by their signs (parts may overlap), "flood".
    parts: sets of triangles that bound a solid of their own: "whole" (all together), "file" (the meshes of together),
        "node" (each instance of one), "mesh", "material"; the shader `label` gives a part's label. part_label,
        part_priority: mappings of patterns to numbers, {"wheel*": 3}, or texts "wheel*=3"; of those that match a part's
        name the last one holds. In a pattern * is any text and ? one character. exclude: a pattern or a list of them:
        parts of these names are left out. With fill "parity" or "nonzero" each part is filled by itself; where parts
        overlap, the one of the highest priority, of equal ones the last one, gives the values of the blend "replace".
        The result's `parts` are a table of them.

    targets: up to 8: Target objects or texts, "[SHADER][:FORMAT[xC]][:BLEND][:key=value,...]" as the command line
        takes them (Target.parse); default: bits of occupancy. Or by keyword, which names them in the result:
        color="base_color:srgb8"; then the bits of occupancy come first, as "mask". A keyword that is an option of the
        command line (preview, target, ...) or close to an option of this call (shaders) is refused;
        targets=[Target(name=...)] takes any name.
    shader: of the targets that name none.
    vertex_shader: such as "transform:matrix=..." or Shader("skin", {"time": 0.5}).
    result: "dense", "sparse" (the occupied bricks of 8x8x8 voxels) or "buckets" (all fragments of each voxel).
    layout: "planar": components first. packed_bits: bits stay eight a byte. compression: "zstd" on the way.
    content_hash: the server's SHA-256 is checked too; each piece has its CRC-32C anyway.
    backend: "cpu" or "cuda" alone. priority: among the server's jobs. strict: the first warning is an error.

    server: an address, a Client or a LocalServer; None: the variable VOXELPIPE_SERVER, else this process if the
        package voxelpipe_core is installed, else a local voxelpiped, started once. The bytes are the same.
    timeout: seconds, retries included; None: 600. progress: callable(stage, fraction, bytes), or True for tqdm's bar.

    Out: a VoxelGrid. Errors: InvalidRequest (UnknownOption, a TypeError too, for a wrong keyword), InvalidMesh,
    TooLarge, Overloaded, Unavailable, DeadlineExceeded and the others of voxelpipe.errors; OSError for files. Ctrl-C
    cancels the call.
    """
    job, file = job_of(mesh, call)
    client = call.server if isinstance(call.server, Client) else default_client(call.server or "")
    return client.run(job, file, timeout=call.timeout, progress=call.progress)


def voxelize_many(
    meshes: Iterable[MeshLike | MeshHandle],
    *,
    server: ServerLike | None = None,
    in_flight: int = 16,
    errors: str = "raise",
    **options: Any,
) -> Iterator[VoxelGrid | VoxelpipeError]:
    """Voxelizes many meshes with the same options: see Client.voxelize_many(). server: see voxelize().

    Without a server the meshes run in batches of in_flight, on all cores or a GPU.
    """
    client = server if isinstance(server, Client) else default_client(server or "")
    return client.voxelize_many(meshes, in_flight=in_flight, errors=errors, **options)


def mesh_info(
    mesh: MeshLike | MeshHandle, *, server: ServerLike | None = None, timeout: float | None = None
) -> MeshInfo:
    """Counts, box and faults of a mesh; without a server its health too: see Client.mesh_info().

        info = voxelpipe.mesh_info("car.glb")
        info.mesh.triangles, info.mesh.min, info.health.watertight, info.health.fill

    mesh, server: see voxelize().
    """
    client = server if isinstance(server, Client) else default_client(server or "")
    return client.mesh_info(mesh, timeout=timeout)


def voxelize_on_device(
    mesh: MeshLike, *, timeout: float | None = None, progress: Progress = None, **options: Any
) -> DeviceGrid:
    """Voxelizes one mesh on a GPU of this process and leaves the result in the GPU's memory.

        r = voxelpipe.voxelize_on_device("car.glb", resolution=512, color="base_color:srgb8")
        torch.from_dlpack(r["color"])    # (nz, ny, nx, 4) uint8 on the GPU, without a copy

    options: those of voxelize() that describe the request, without backend. Needs the package voxelpipe_core built with
    CUDA. Errors: those of voxelize(); NotAvailable if there is no GPU, or the result is sparse, bucketed or too large
    to be made in one slab; MissingPackage without voxelpipe_core.
    """
    core_module.needed("voxelize_on_device")
    call = make_call(backend="cuda", **options)
    several = call.together is not None
    job = job_of(mesh, call)[0] if several else Job(call.request, load_mesh(mesh))
    return in_process.run_on_device(job, checked_timeout(timeout), progress)


def shutdown(_: Any = None) -> None:
    """Closes the clients of voxelize(), and ends the local server."""
    global _server
    with _lock:
        for client in _clients.values():
            client.close()
        _clients.clear()
        if _server is not None:
            _server.stop()
        _server = None
