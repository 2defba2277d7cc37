from typing import Any, Callable

import numpy
import numpy.typing

class Failed(RuntimeError):
    """args[0]: a google.rpc.Status as bytes."""

def run(
    config: bytes, mesh: Any, timeout: float | None, progress: Callable[[str, float], None] | None
) -> tuple[bytes, list[numpy.typing.NDArray[numpy.uint8]], bytes]:
    """Runs one request; the GIL is released meanwhile.

    config: a VoxelizeConfig. mesh: a buffer with the bytes of a mesh file that refers to no others. timeout: seconds.
    progress: called from another thread. Out: a ResultHeader, the arrays in stream order as flat bytes that own their
    memory, a Summary. Errors: Failed; what progress or a signal handler raised, after the job has ended.
    """

def shaders() -> bytes:
    """All shaders: a ListShadersResponse."""
