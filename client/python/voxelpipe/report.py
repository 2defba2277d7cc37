"""What a server says beside a result: counts, times, warnings; and of itself."""
from __future__ import annotations

import dataclasses
import math
import string
from typing import Any

from ._proto.voxelpipe.v1 import types_pb2 as types
from ._proto.voxelpipe.v1 import voxelization_service_pb2 as service
from .errors import DataLoss
from .place import GridPlace, Vector

# The bounds of every server's grids and warnings.
_MAX_AXIS = 1 << 20
_MAX_VOXELS = 1 << 53
_MAX_WARNINGS = 100
_MAX_TEXT_CHARACTERS = 256

_MESH_ID_DIGITS = 64


def _broken(why: str) -> DataLoss:
    return DataLoss(f"the server's answer: {why}")


def _vector(message: types.Vec3) -> Vector:
    return message.x, message.y, message.z


def _optional(message: Any, field: str) -> Any:
    return getattr(message, field) if message.HasField(field) else None


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
    """The warnings of a Summary, a StoredMesh or an estimate; a last one counts those that were left out.

    Those beyond what a server may send are left out too.
    """
    listed = []
    for warning in message.warnings[:_MAX_WARNINGS]:
        known = warning.code in types.WarningCode.values()
        code = types.WarningCode.Name(warning.code).removeprefix("WARNING_CODE_").lower() if known else "unknown"
        listed.append(MeshWarning(code, warning.place[:_MAX_TEXT_CHARACTERS], warning.text[:_MAX_TEXT_CHARACTERS]))
    left_out = message.warnings_left_out + len(message.warnings) - len(listed)
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
        """From the service's message."""
        return MeshReport(
            message.triangles,
            message.vertices,
            _optional(message, "degenerate_triangles"),
            _optional(message, "open_edges"),
            _vector(message.min),
            _vector(message.max),
        )


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
    def of(message: service.Summary, request_id: str = "") -> "Summary":
        """From the service's message."""
        stats = message.stats
        return Summary(
            triangles=stats.triangles,
            triangles_outside=stats.triangles_outside,
            occupied=stats.occupied,
            fragments=_optional(stats, "fragments"),
            odd_columns=_optional(stats, "odd_columns"),
            backend=stats.backend,
            simd=stats.simd,
            path=tuple(stats.path),
            stages={stage.stage: stage.milliseconds for stage in stats.stages},
            voxelize_ms=stats.voxelize_ms,
            voxelize_cpu_ms=stats.voxelize_cpu_ms,
            worker=stats.worker,
            queue_ms=stats.queue_ms,
            batch_jobs=stats.batch_jobs,
            attempts=stats.attempts,
            mesh=MeshReport.of(message.mesh),
            peak_bytes=message.peak_bytes,
            result_bytes=message.result_bytes,
            sent_bytes=message.sent_bytes,
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
        known = plan.time_class in service.TimeClass.values()
        time_class = service.TimeClass.Name(plan.time_class).removeprefix("TIME_CLASS_").lower() if known else ""
        mesh = MeshReport.of(message.mesh) if message.HasField("mesh") else None
        return Estimate(
            read_place(plan.grid),
            plan.result_bytes,
            plan.peak_bytes,
            plan.backend,
            time_class,
            mesh,
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
    """A shader of the server. stage: "vertex" or "fragment". output_components: 1 to 4; 0 of a vertex shader."""

    name: str
    stage: str
    description: str
    output_type: str
    output_components: int
    reads_textures: bool
    parameters: tuple[ShaderParameterInfo, ...]

    @staticmethod
    def of(message: service.ShaderInfo) -> "ShaderInfo":
        """From the service's message."""
        return ShaderInfo(
            message.name,
            "vertex" if message.stage == service.SHADER_STAGE_VERTEX else "fragment",
            message.description,
            message.output_type,
            message.output_components,
            message.reads_textures,
            tuple(
                ShaderParameterInfo(one.name, one.type, tuple(one.default_value), one.description)
                for one in message.parameters
            ),
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

    limits: bytes and counts by the names of the service's ServerLimits, such as "max_result_bytes".
    """

    version: str
    backends: dict[str, str]
    threads: int
    limits: dict[str, int]
    devices: tuple[Device, ...]

    @staticmethod
    def of(message: service.GetServerInfoResponse) -> "ServerInfo":
        """From the service's message."""
        limits = message.limits
        return ServerInfo(
            message.version,
            {backend.name: backend.simd for backend in message.backends},
            message.threads,
            {field.name: int(getattr(limits, field.name)) for field in limits.DESCRIPTOR.fields},
            tuple(
                Device(
                    device.name,
                    device.backend,
                    device.model,
                    device.memory_bytes,
                    device.workers,
                    device.state != service.DEVICE_STATE_QUARANTINED,
                    device.reason,
                )
                for device in message.devices
            ),
        )


@dataclasses.dataclass(frozen=True)
class StoredMesh:
    """A mesh that a server keeps. mesh_id: the SHA-256 of its bytes. uses: jobs that used it."""

    mesh_id: str
    file_bytes: int
    memory_bytes: int
    uses: int
    mesh: MeshReport
    warnings: tuple[MeshWarning, ...]

    @staticmethod
    def of(message: service.StoredMesh) -> "StoredMesh":
        """From the service's message. Errors: DataLoss."""
        if len(message.mesh_id) != _MESH_ID_DIGITS or not all(digit in string.hexdigits for digit in message.mesh_id):
            raise _broken(f"{message.mesh_id[:_MESH_ID_DIGITS]!r} names no mesh")
        return StoredMesh(
            message.mesh_id,
            message.file_bytes,
            message.memory_bytes,
            message.uses,
            MeshReport.of(message.mesh),
            read_warnings(message),
        )
