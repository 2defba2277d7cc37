from typing import Any, Callable, TypedDict

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

class Format(TypedDict):
    """A format of output files.

    name: as the command line's --format. extension: with its dot. title: a few words. kinds: of results that it holds.
    targets: what becomes of several: "together" in a file, "file_each", "one" alone is possible, "drawn" (the occupied
    voxels and their colours). picture: the command line draws it; write() does not. directory: the file is one.
    """

    name: str
    extension: str
    title: str
    kinds: tuple[str, ...]
    targets: str
    picture: bool
    directory: bool

def formats() -> list[Format]:
    """All formats that this build has."""

def not_kept(config: bytes, header: bytes, path: bytes) -> str:
    """What a file would not tell of a result, as one line; empty if nothing is lost.

    In: the arguments of write(). Errors: Failed for a format that cannot hold the result, and for a strict request if
    something is lost.
    """

def write(config: bytes, header: bytes, arrays: list[Any], path: bytes) -> None:
    """Writes a result to a file by the writer of its extension, as the command line does; the GIL is released.

    config: a VoxelizeConfig. header: a ResultHeader. arrays: in stream order, flat buffers of the header's sizes. The
    file appears when it is complete; after an error there is none. Errors: Failed; OSError; what a signal handler
    raised, after the writer has ended.
    """
