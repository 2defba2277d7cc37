from typing import Any, Callable

class Failed(RuntimeError):
    """args[0]: a google.rpc.Status as bytes."""

class DeviceBuffer:
    """Bytes in a GPU's memory."""

    @property
    def pointer(self) -> int: ...
    @property
    def size(self) -> int: ...
    @property
    def ordinal(self) -> int:
        """The GPU's CUDA ordinal."""

    def dlpack(self, code: int, bits: int, shape: list[int]) -> Any:
        """A DLPack capsule that keeps the memory. code: 1 unsigned, 2 float. shape: in C order."""

def run(
    config: bytes,
    mesh: Any,
    timeout: float | None,
    progress: Callable[[str, float], None] | None,
    on_device: bool = False,
) -> tuple[bytes, list[Any], bytes]:
    """Runs one request; the GIL is released meanwhile.

    config: a VoxelizeConfig. mesh: a buffer with the bytes of a mesh file that refers to no others. timeout: seconds.
    progress: called from another thread. Out: a ResultHeader, the arrays in stream order as flat bytes that own their
    memory (numpy, uint8), or DeviceBuffer objects with on_device, a Summary. Errors: Failed; what progress or a signal
    handler raised, after the job has ended.
    """

def shaders() -> bytes:
    """All shaders: a ListShadersResponse."""
