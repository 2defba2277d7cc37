"""What a server says beside a result: counts, times, warnings; and of itself."""
from __future__ import annotations

import dataclasses
import math
import re
from typing import Any

from ._proto.voxelpipe.v1 import mesh_pb2, result_pb2, server_info_pb2
from ._proto.voxelpipe.v1 import types_pb2 as types
from ._proto.voxelpipe.v1 import voxelization_service_pb2 as service
from .errors import DataLoss
from .names import Fill
from .place import GridPlace, Vector

# The bounds of every server's grids and warnings.
_MAX_AXIS = 1 << 20
_MAX_VOXELS = 1 << 53
_MAX_WARNINGS = 100
_MAX_TEXT_CHARACTERS = 256

_MESH_NAME = re.compile("meshes/[0-9a-f]{64}(-(mm|cm|m|in))?(-(glb|gltf|drc|stl|ply|off|obj|3mf))?")
_MAX_NAME_CHARACTERS = 80
_MAX_SECONDS = 315_576_000_000  # of a Duration: 10,000 years
_UNKNOWN = "unknown"  # a value of an enum that this client does not know


def _names(enum: Any, prefix: str) -> dict[int, str]:
    """The names of an enum's values, in lower case; of UNSPECIFIED an empty one."""
    listed = {value: name.removeprefix(prefix).lower() for name, value in enum.items()}
    return listed | {0: ""}


_BACKENDS = _names(types.Backend, "BACKEND_")
_SIMDS = _names(types.Simd, "SIMD_")
_ELEMENTS = _names(types.ElementType, "ELEMENT_TYPE_")
_TIME_CLASSES = _names(result_pb2.TimeClass, "TIME_CLASS_")
_PARAMETERS = _names(server_info_pb2.ShaderParameterType, "SHADER_PARAMETER_TYPE_")
_WARNINGS = _names(types.WarningCode, "WARNING_CODE_")


def _broken(why: str) -> DataLoss:
    return DataLoss(f"the server's answer: {why}")


def _vector(message: types.Vec3) -> Vector:
    return message.x, message.y, message.z


def _count(message: Any, field: str) -> int:
    """A count or a size. Errors: DataLoss if it is negative."""
    count: int = getattr(message, field)
    if count < 0:
        raise _broken(f"{field} is {count}")
    return count


def _optional(message: Any, field: str) -> int | None:
    return _count(message, field) if message.HasField(field) else None


def _milliseconds(message: Any, field: str) -> float:
    """A time. Errors: DataLoss if it is negative, or no Duration."""
    time = getattr(message, field)
    if not (0 <= time.seconds <= _MAX_SECONDS and 0 <= time.nanos < 1_000_000_000):
        raise _broken(f"{field} is {time.seconds} s and {time.nanos} ns")
    milliseconds: float = time.seconds * 1e3 + time.nanos / 1e6
    return milliseconds


def _simd(message: Any) -> str:
    """The instruction set of a message with a backend too; "cuda" of that backend, which has none."""
    backend = _BACKENDS.get(message.backend, _UNKNOWN)
    return _SIMDS.get(message.simd, _UNKNOWN) or (backend if backend == "cuda" else "")


@dataclasses.dataclass(frozen=True)
class MeshWarning:
    """An input that was accepted although something in it is wrong. code: lower case, such as "texture_missing".

    place: the part of the input, such as "image 3"; empty: the whole. text: what is wrong and what was done.
    """

    code: str
    place: str
    text: str

    def __str__(self) -> str:
        return f"{self.code}: {self.place}: {self.text}" if self.place else f"{self.code}: {self.text}"


def read_warnings(message: Any) -> tuple[MeshWarning, ...]:
    """The warnings of a Summary, a Mesh or an estimate; a last one counts those that were left out.

    Those beyond what a server may send are left out too. Errors: DataLoss.
    """
    listed = []
    for warning in message.warnings[:_MAX_WARNINGS]:
        code = _WARNINGS.get(warning.code) or _UNKNOWN
        listed.append(MeshWarning(code, warning.place[:_MAX_TEXT_CHARACTERS], warning.text[:_MAX_TEXT_CHARACTERS]))
    left_out = _count(message, "warnings_left_out") + len(message.warnings) - len(listed)
    if left_out:
        listed.append(MeshWarning("left_out", "", f"{left_out} further warnings"))
    return tuple(listed)


@dataclasses.dataclass(frozen=True)
class MeshReport:
    """Facts about a mesh. min, max: box of its vertices before the vertex shader, world units.

    degenerate_triangles, open_edges: counted for requests with a fill, else None.
    """

    triangles: int
    vertices: int
    degenerate_triangles: int | None
    open_edges: int | None
    min: Vector
    max: Vector

    @staticmethod
    def of(message: types.MeshReport) -> "MeshReport":
        """From the service's message. Errors: DataLoss."""
        return MeshReport(
            _count(message, "triangles"),
            _count(message, "vertices"),
            _optional(message, "degenerate_triangles"),
            _optional(message, "open_edges"),
            _vector(message.min),
            _vector(message.max),
        )


@dataclasses.dataclass(frozen=True)
class MeshHealth:
    """What in a mesh keeps a fill from being exact, by the names of `voxelpipe info --json`.

    Edges and shells are those after welding equal positions. open_edges: used by an odd number of triangles;
    non_manifold_edges: by more than two; inconsistent_edges: not half of the times in each direction. shells: triangles
    that are connected through edges. flipped_shells: closed ones that face inward; cavities: those of them that lie in
    others which face outward. volume: of the closed, oriented shells, world units cubed. fill: that which suits the
    mesh, for voxelize(), and why.
    """

    watertight: bool
    edges: int
    open_edges: int
    non_manifold_edges: int
    inconsistent_edges: int
    degenerate_triangles: int
    duplicate_triangles: int
    duplicate_vertices: int
    not_finite_vertices: int
    shells: int
    closed_shells: int
    flipped_shells: int
    nested_shells: int
    cavities: int
    overlapping_shells: int
    shells_whose_boxes_overlap: int
    undecided_shells: int
    volume: float
    fill: Fill
    why: str


@dataclasses.dataclass(frozen=True)
class MeshInfo:
    """What a mesh is like. health: None of a server, which does not check it."""

    mesh: MeshReport
    warnings: tuple[MeshWarning, ...]
    health: MeshHealth | None


@dataclasses.dataclass(frozen=True)
class Summary:
    """How a request ran. Times in milliseconds, sizes in bytes.

    triangles_outside: triangles whose boxes lie beside a grid that was given, after the vertex shader; 0 for fitted
    grids. occupied: voxels with a fragment or fill. fragments: (triangle, voxel) pairs; None where they were not
    counted. odd_columns: with a fill by crossings: columns of an open mesh. stages: wall time by name, in the order of
    execution. path: how each target was computed. content_sha256: the server's, empty unless asked for. sent_bytes: of
    the result as received, compressed or not. attempts: workers that tried the job.
    """

    triangles: int
    triangles_outside: int
    occupied: int
    fragments: int | None
    odd_columns: int | None
    backend: str
    simd: str
    path: tuple[str, ...]
    stages: dict[str, float]
    voxelize_ms: float
    voxelize_cpu_ms: float
    worker: str
    queue_ms: float
    batch_jobs: int
    attempts: int
    mesh: MeshReport
    peak_bytes: int
    result_bytes: int
    sent_bytes: int
    cached: bool
    content_sha256: str
    request_id: str = ""

    @staticmethod
    def of(message: result_pb2.Summary, request_id: str = "") -> "Summary":
        """From the service's message. Errors: DataLoss."""
        stats = message.stats
        return Summary(
            triangles=_count(stats, "triangles"),
            triangles_outside=_count(stats, "triangles_outside"),
            occupied=_count(stats, "occupied"),
            fragments=_optional(stats, "fragments"),
            odd_columns=_optional(stats, "odd_columns"),
            backend=_BACKENDS.get(stats.backend, _UNKNOWN),
            simd=_simd(stats),
            path=tuple(stats.path),
            stages={stage.stage: _milliseconds(stage, "time") for stage in stats.stages},
            voxelize_ms=_milliseconds(stats, "voxelize_time"),
            voxelize_cpu_ms=_milliseconds(stats, "voxelize_cpu_time"),
            worker=stats.worker,
            queue_ms=_milliseconds(stats, "queue_time"),
            batch_jobs=_count(stats, "batch_jobs"),
            attempts=_count(stats, "attempts"),
            mesh=MeshReport.of(message.report),
            peak_bytes=_count(message, "peak_bytes"),
            result_bytes=_count(message, "result_bytes"),
            sent_bytes=_count(message, "sent_bytes"),
            cached=message.cached,
            content_sha256=message.content_sha256,
            request_id=request_id,
        )


def read_place(grid: types.Grid) -> GridPlace:
    """The place of a result's or a plan's grid. Errors: DataLoss if no grid can be like that."""
    dims = grid.dims.x, grid.dims.y, grid.dims.z
    x, y, z = origin = _vector(grid.origin)
    sx, sy, sz = size = _vector(grid.voxel_size)
    if min(dims) < 1 or max(dims) > _MAX_AXIS:
        raise _broken(f"a grid of {dims[0]} x {dims[1]} x {dims[2]} voxels")
    if dims[0] * dims[1] * dims[2] > _MAX_VOXELS:
        raise _broken("a grid beyond 2^53 voxels")
    finite = math.isfinite(x) and math.isfinite(y) and math.isfinite(z)
    if not (finite and 0 < sx < math.inf and 0 < sy < math.inf and 0 < sz < math.inf):
        raise _broken("a grid whose voxel size is not positive or whose origin is not finite")
    return GridPlace(dims, origin, size)


@dataclasses.dataclass(frozen=True)
class Estimate:
    """The plan of a request, without running it.

    result_bytes: of all arrays (an estimate unless dense). peak_bytes: predicted memory on the server, without mesh.
    time_class: "instant" (below 0.1 s on two cores), "short" (below 2 s) or "long". mesh: None for a mesh by its size.
    """

    place: GridPlace
    result_bytes: int
    peak_bytes: int
    backend: str
    time_class: str
    mesh: MeshReport | None
    warnings: tuple[MeshWarning, ...]

    @staticmethod
    def of(message: service.EstimateVoxelizationResponse) -> "Estimate":
        """From the service's message. Errors: DataLoss."""
        plan = message.plan
        return Estimate(
            read_place(plan.grid),
            _count(plan, "result_bytes"),
            _count(plan, "peak_bytes"),
            _BACKENDS.get(plan.backend, _UNKNOWN),
            _TIME_CLASSES.get(plan.time_class, _UNKNOWN),
            MeshReport.of(message.report) if message.HasField("report") else None,
            read_warnings(message),
        )


@dataclasses.dataclass(frozen=True)
class ShaderParameterInfo:
    """A parameter of a shader. type: "float", "floats", "vec3", "vec4", "mat4", "uint" or "string"."""

    name: str
    type: str
    default: tuple[float, ...]
    description: str


@dataclasses.dataclass(frozen=True)
class ShaderInfo:
    """A shader of the server. stage: "vertex" or "fragment". output_type: "f32" or "u32"; "position" of a vertex
    shader. output_components: 1 to 4; 0 of a vertex shader.
    """

    name: str
    stage: str
    description: str
    output_type: str
    output_components: int
    reads_textures: bool
    parameters: tuple[ShaderParameterInfo, ...]

    @staticmethod
    def of(message: server_info_pb2.ShaderInfo) -> "ShaderInfo":
        """From the service's message. Errors: DataLoss."""
        vertex = message.stage == server_info_pb2.SHADER_STAGE_VERTEX
        parameters = [
            ShaderParameterInfo(
                one.name, _PARAMETERS.get(one.type, _UNKNOWN), tuple(one.default_values), one.description
            )
            for one in message.parameters
        ]
        return ShaderInfo(
            message.name,
            "vertex" if vertex else "fragment",
            message.description,
            _ELEMENTS.get(message.output_type, _UNKNOWN) or ("position" if vertex else ""),
            _count(message, "output_components"),
            message.reads_textures,
            tuple(parameters),
        )


@dataclasses.dataclass(frozen=True)
class Device:
    """A device of the server. workers: batches that run on it at the same time. reason: why it does not serve."""

    name: str
    backend: str
    model: str
    memory_bytes: int
    workers: int
    serving: bool
    reason: str


@dataclasses.dataclass(frozen=True)
class ServerInfo:
    """A server's version, backends (best first, with the instruction set of each), threads, limits and devices.

    contract_revision: of the service; grows with each change of it. limits: bytes and counts by the names of the
    service's ServerLimits, such as "max_result_bytes".
    """

    version: str
    contract_revision: int
    backends: dict[str, str]
    threads: int
    limits: dict[str, int]
    devices: tuple[Device, ...]

    @staticmethod
    def of(message: server_info_pb2.GetServerInfoResponse) -> "ServerInfo":
        """From the service's message. Errors: DataLoss."""
        limits = message.limits
        return ServerInfo(
            message.version,
            _count(message, "contract_revision"),
            {_BACKENDS.get(one.backend, _UNKNOWN): _simd(one) for one in message.backends},
            _count(message, "threads"),
            {field.name: _count(limits, field.name) for field in limits.DESCRIPTOR.fields},
            tuple(
                Device(
                    device.name,
                    _BACKENDS.get(device.backend, _UNKNOWN),
                    device.model,
                    _count(device, "memory_bytes"),
                    _count(device, "workers"),
                    device.state != server_info_pb2.DEVICE_STATE_QUARANTINED,
                    device.reason,
                )
                for device in message.devices
            ),
        )


@dataclasses.dataclass(frozen=True)
class StoredMesh:
    """A mesh that a server keeps. name: "meshes/" and the SHA-256 of its bytes, then the unit and the format that were
    given with it. uses: jobs that used it.
    """

    name: str
    file_bytes: int
    memory_bytes: int
    uses: int
    mesh: MeshReport
    warnings: tuple[MeshWarning, ...]

    @staticmethod
    def of(message: mesh_pb2.Mesh) -> "StoredMesh":
        """From the service's message. Errors: DataLoss."""
        if not _MESH_NAME.fullmatch(message.name):
            raise _broken(f"{message.name[:_MAX_NAME_CHARACTERS]!r} names no mesh")
        return StoredMesh(
            message.name,
            _count(message, "file_bytes"),
            _count(message, "memory_bytes"),
            _count(message, "uses"),
            MeshReport.of(message.report),
            read_warnings(message),
        )
