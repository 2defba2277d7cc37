"""VoxelPipe's core in this process. Where it is installed, voxelpipe.voxelize() needs no server.

It speaks the messages of the service as bytes; programs use voxelpipe.voxelize().
"""
from ._core import (
    DeviceBuffer,
    Failed,
    HeldMesh,
    estimate,
    formats,
    load,
    load_all,
    not_kept,
    run,
    run_all,
    shaders,
    write,
)

__all__ = [
    "DeviceBuffer",
    "Failed",
    "HeldMesh",
    "estimate",
    "formats",
    "load",
    "load_all",
    "not_kept",
    "run",
    "run_all",
    "shaders",
    "write",
]
