"""Turns triangle meshes into voxels, with a VoxelPipe server.

    import voxelpipe
    r = voxelpipe.voxelize("car.glb", resolution=256, color="base_color:srgb8")
    r.mask, r.color, r.world(r.occupied())

Voxel (i, j, k) spans [i, i+1) x [j, j+1) x [k, k+1) in index space; arrays have the shape (nz, ny, nx[, c]), so the
voxel (i, j, k) is array[k, j, i].
"""
from . import errors
from ._calls.session import Tls
from ._version import VERSION
from .aio import AsyncClient
from .api import default_client, mesh_info, shutdown, voxelize, voxelize_many, voxelize_on_device
from .buckets import Buckets
from .client import Client
from .device import DeviceArray, DeviceGrid
from .errors import (
    DataLoss,
    DeadlineExceeded,
    InvalidMesh,
    InvalidRequest,
    MeshNotFound,
    MissingPackage,
    NotAvailable,
    Overloaded,
    PermissionDenied,
    QuotaExceeded,
    TooLarge,
    Unauthenticated,
    Unavailable,
    UnknownOption,
    VoxelpipeError,
)
from ._mesh.forms import MeshFile, load_mesh
from ._mesh.glb import Mesh
from ._mesh.placed import Motion
from .grid import Sparse, VoxelGrid
from .in_process_client import InProcessClient
from .local_server import LocalServer, local_server
from .mesh_handle import MeshHandle
from .part_table import Part, Parts
from .place import GridPlace
from .report import Estimate, MeshHealth, MeshInfo, MeshReport, MeshWarning, ServerInfo, ShaderInfo, StoredMesh, Summary
from .stored import load_result, make_grid
from .targets import Shader, Target

__version__ = VERSION

__all__ = [
    "AsyncClient",
    "Buckets",
    "Client",
    "DataLoss",
    "DeadlineExceeded",
    "DeviceArray",
    "DeviceGrid",
    "Estimate",
    "GridPlace",
    "InProcessClient",
    "InvalidMesh",
    "InvalidRequest",
    "LocalServer",
    "Mesh",
    "MeshFile",
    "MeshHandle",
    "MeshHealth",
    "MeshInfo",
    "MeshNotFound",
    "MeshReport",
    "MeshWarning",
    "MissingPackage",
    "Motion",
    "NotAvailable",
    "Overloaded",
    "Part",
    "Parts",
    "PermissionDenied",
    "QuotaExceeded",
    "ServerInfo",
    "Shader",
    "ShaderInfo",
    "Sparse",
    "StoredMesh",
    "Summary",
    "Target",
    "Tls",
    "TooLarge",
    "Unauthenticated",
    "Unavailable",
    "UnknownOption",
    "VoxelGrid",
    "VoxelpipeError",
    "default_client",
    "errors",
    "load_mesh",
    "load_result",
    "local_server",
    "make_grid",
    "mesh_info",
    "shutdown",
    "voxelize",
    "voxelize_many",
    "voxelize_on_device",
]
