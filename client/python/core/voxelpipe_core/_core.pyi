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

class HeldMesh:
    """A mesh that stays loaded, for many requests at the same time."""

    def describe(self) -> bytes:
        """A Mesh."""

    def health(self, timeout: float | None) -> dict[str, Any]:
        """What voxelpipe.MeshHealth has, by its names. Errors: as run()."""

def load(
    mesh: Any,
    format: int,
    unit: int,
    name: str,
    timeout: float | None,
    progress: Callable[[str, float], None] | None,
) -> HeldMesh:
    """Loads a mesh file, whose bytes are not needed later. In: MeshFormat, LengthUnit; otherwise as run()."""

def load_all(meshes: list[tuple[Any, int, int, str]], timeout: float | None) -> list[HeldMesh | bytes]:
    """Loads several mesh files side by side. In: each with its MeshFormat, LengthUnit and name. timeout: of each. Out:
    of each what load() gives, or its error, a google.rpc.Status as bytes.
    """

def run(
    request: bytes,
    mesh: Any,
    timeout: float | None,
    progress: Callable[[str, float], None] | None,
    on_device: bool = False,
    positions: Any = None,
) -> tuple[bytes, list[Any], bytes]:
    """Runs one request; the GIL is released meanwhile.

    request: a VoxelizeRequest; of a mesh in it only format and unit are read. mesh: a HeldMesh, or a buffer with the
    bytes of a mesh file that refers to no others; of a request that places several a list of HeldMesh, whose names
    those of the request are. timeout: seconds. progress: called from another thread. positions: of a held mesh: a
    buffer of float32 x, y, z of each vertex. Out: a ResultHeader, the arrays in stream order as flat bytes that own
    their memory (numpy, uint8), with on_device the targets as DeviceBuffer objects, a Summary. Errors: Failed; what progress or a
    signal handler raised, after the job has ended.
    """

def run_all(
    request: bytes, meshes: list[tuple[Any, int, int]], timeout: float | None
) -> list[tuple[bytes, list[Any], bytes] | bytes]:
    """Runs the same request of many meshes, as batches of the core.

    meshes: each a HeldMesh or a buffer, with its MeshFormat and LengthUnit. timeout: of each. Out: of each what run()
    gives, or its error, a google.rpc.Status as bytes.
    """

def estimate(request: bytes, mesh: Any, timeout: float | None) -> bytes:
    """The plan of a request: an EstimateVoxelizationResponse. In, errors: as run()."""

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

def not_kept(request: bytes, header: bytes, path: bytes) -> str:
    """What a file would not tell of a result, as one line; empty if nothing is lost.

    In: the arguments of write(). Errors: Failed for a format that cannot hold the result, and for a strict request if
    something is lost.
    """

def write(request: bytes, header: bytes, arrays: list[Any], path: bytes) -> None:
    """Writes a result to a file by the writer of its extension, as the command line does; the GIL is released.

    request: a VoxelizeRequest. header: a ResultHeader. arrays: in stream order, flat buffers of the header's sizes. The
    file appears when it is complete; after an error there is none. Errors: Failed; OSError; what a signal handler
    raised, after the writer has ended.
    """
