"""A request: what to make of a mesh. Checked here as far as that needs no server."""
from __future__ import annotations

import dataclasses
import functools
import math
from typing import TYPE_CHECKING, Any, Mapping, Sequence, Union, get_args

import numpy.typing

from . import names as kinds
from ._calls.address import ServerLike
from ._calls.progress import Progress
from ._mesh.parts import RulesLike, selection
from ._mesh.placed import MotionLike, Together, TransformLike
from ._proto.voxelpipe.v1 import request_pb2
from ._proto.voxelpipe.v1 import types_pb2 as types
from ._request.axes import turned
from ._request.clip import clipped
from ._request.keywords import check_target_names
from .errors import InvalidRequest, UnknownOption
from .place import GridPlace
from .targets import Shader, Target

if TYPE_CHECKING:
    from .grid import VoxelGrid

TargetLike = Union[Target, str]
ShaderLike = Union[Shader, str]

_DEFAULT_RESOLUTION = 128
_MAX_TARGETS = 8
_MOST = 1 << 31


@dataclasses.dataclass(frozen=True)
class Request:
    """All of a request but the mesh. Made by make_request() (options.py)."""

    message: request_pb2.VoxelizeRequest  # without a mesh
    targets: tuple[Target, ...]
    packed_bits: bool = False
    content_hash: bool = False

    @property
    def spec(self) -> request_pb2.VoxelizeSpec:
        """What is made."""
        return self.message.spec

    @functools.cached_property
    def encoded(self) -> bytes:
        """The message as bytes."""
        encoded: bytes = self.message.SerializeToString()
        return encoded

    @property
    def has_parts(self) -> bool:
        """True if the mesh is cut into parts, so that the result has a table of them."""
        return self.spec.parts.scope not in (request_pb2.PART_SCOPE_UNSPECIFIED, request_pb2.PART_SCOPE_WHOLE)

    def small_result(self, limit_bytes: int) -> bool:
        """True if the result can only be at most this large: dense, on a bounded grid, without a table of parts."""
        dense = self.spec.result == request_pb2.RESULT_KIND_DENSE
        return dense and not self.has_parts and self.dense_bytes() <= limit_bytes

    def dense_bytes(self) -> float:
        """The most bytes of a dense result with the grid and the targets of this request; infinite if unknown."""
        grid = self.spec.grid
        form = grid.WhichOneof("form")
        if form == "voxel_size":
            return math.inf
        if form == "resolution":
            axes = (grid.resolution.voxels,) * 3
        else:
            dims = grid.placement.dims if form == "placement" else grid.dims
            axes = (dims.x, dims.y, dims.z)
        voxels = math.prod(max(0, axis + 2 * grid.padding) for axis in axes)
        sizes = {"bit": 0.125, "u8": 1, "u16": 2, "f16": 2, "u32": 4, "f32": 4}
        return sum(voxels * sizes[target.format] * (target.components or 4) for target in self.targets)


def per_axis(value: Any, field: str) -> tuple[float, float, float]:
    try:
        one = not hasattr(value, "__len__") or getattr(value, "ndim", 1) == 0
        numbers = [float(value)] * 3 if one else [float(number) for number in value]
    except (TypeError, ValueError):
        numbers = []
    if len(numbers) != 3 or not all(math.isfinite(number) for number in numbers):
        raise InvalidRequest(f"{field}: {value!r} is neither a number nor three", field=field)
    return numbers[0], numbers[1], numbers[2]


def _whole(value: Any, field: str) -> int:
    try:
        whole = int(value)
        if not isinstance(value, (bool, str)) and whole == value and abs(whole) < _MOST:
            return whole
    except (TypeError, ValueError, OverflowError):
        pass
    raise InvalidRequest(f"{field}: {value!r} is no whole number below 2^31", field=field)


def checked_in_flight(value: Any) -> int:
    """How many meshes are in memory at the same time. Errors: InvalidRequest if it is no whole number above 0."""
    whole = _whole(value, "in_flight")
    if whole < 1:
        raise InvalidRequest(f"in_flight: {value!r} is below 1", field="in_flight")
    return whole


def checked_timeout(value: Any) -> float | None:
    """A `timeout` as seconds; None stays. Errors: InvalidRequest if it is no number."""
    if value is None:
        return None
    try:
        seconds = float(value) if not isinstance(value, (bool, str)) else math.nan
    except (TypeError, ValueError, OverflowError):
        seconds = math.nan
    if math.isnan(seconds):
        raise InvalidRequest(f"timeout: {value!r} is no number of seconds", field="timeout")
    return seconds


def _choice(enum: Any, prefix: str, value: str, allowed: Any, field: str) -> Any:
    if value not in get_args(allowed):
        raise InvalidRequest(f"{field}: '{value}' is none of {', '.join(get_args(allowed))}", field=field)
    return enum.Value(f"{prefix}_{value.upper()}")


def _grid(
    resolution: int | None,
    voxel_size: kinds.PerAxis | None,
    dims: Sequence[int] | None,
    origin: Sequence[float] | None,
    like: "VoxelGrid | GridPlace | None",
    fit: kinds.Fit,
    padding: int,
    clip: "numpy.typing.ArrayLike | None",
) -> request_pb2.GridRequest:
    if like is not None:
        given = (resolution, voxel_size, dims, origin, clip)
        if any(value is not None for value in given) or padding or fit == "cube":
            raise InvalidRequest("like: gives the whole grid; leave out the other options of the grid", field="like")
        place = getattr(like, "place", like)
        if not isinstance(place, GridPlace):
            raise InvalidRequest(f"like: {like!r} is neither a VoxelGrid nor a GridPlace", field="like")
        voxel_size, dims, origin = place.voxel_size, place.dims, place.origin_corner
    if resolution is not None and (voxel_size is not None or dims is not None):
        other = "voxel_size" if voxel_size is not None else "dims"
        raise InvalidRequest(f"resolution: cannot be given together with {other}", field="resolution")
    if fit == "cube" and (voxel_size is not None or dims is not None):
        other = "a voxel size" if voxel_size is not None else "dims"
        raise InvalidRequest(f"fit: a cube goes with a resolution, not with {other}", field="fit")
    if origin is not None and dims is None:
        raise InvalidRequest("dims: an origin is given together with dims and a voxel size", field="dims")
    if dims is not None and origin is not None and voxel_size is None:
        raise InvalidRequest("voxel_size: a grid given by dims and origin needs a voxel size", field="voxel_size")
    if dims is not None and voxel_size is not None and origin is None:
        raise InvalidRequest(
            "origin: a grid given by dims and a voxel size needs an origin; dims alone are fitted to the mesh",
            field="origin",
        )
    if _whole(padding, "padding") < 0:
        raise InvalidRequest(f"padding: {padding!r} is below 0", field="padding")
    grid = request_pb2.GridRequest(padding=_whole(padding, "padding"))
    placed: Any = grid.placement if origin is not None else grid
    code = _choice(request_pb2.GridFit, "GRID_FIT", fit, kinds.Fit, "fit")
    if dims is not None:
        if not hasattr(dims, "__getitem__") or len(dims) != 3:
            raise InvalidRequest(f"dims: {dims!r} are not three numbers: x, y, z", field="dims")
        sizes = [_whole(axis, "dims") for axis in dims]
        if min(sizes) < 1:
            raise InvalidRequest(f"dims: {dims!r} are not above 0", field="dims")
        placed.dims.CopyFrom(types.Dims(x=sizes[0], y=sizes[1], z=sizes[2]))
    elif voxel_size is None:
        voxels = _whole(_DEFAULT_RESOLUTION if resolution is None else resolution, "resolution")
        if voxels < 1:
            raise InvalidRequest(f"resolution: {voxels} is below 1", field="resolution")
        grid.resolution.CopyFrom(request_pb2.GridResolution(voxels=voxels, fit=code))
    if voxel_size is not None:
        x, y, z = per_axis(voxel_size, "voxel_size")
        if min(x, y, z) <= 0:
            raise InvalidRequest(f"voxel_size: {voxel_size!r} is not above 0", field="voxel_size")
        placed.voxel_size.CopyFrom(types.Vec3(x=x, y=y, z=z))
    if origin is not None:
        x, y, z = per_axis(origin, "origin")
        grid.placement.origin.CopyFrom(types.Vec3(x=x, y=y, z=z))
    return grid if clip is None else clipped(grid, clip)


def _shader(shader: ShaderLike | None, field: str) -> Shader | None:
    if shader is not None and not isinstance(shader, (Shader, str)):
        raise InvalidRequest(f"{field}: {shader!r} is neither a Shader nor a text", field=field)
    if not isinstance(shader, str):
        return shader
    try:
        return Shader.parse(shader)
    except InvalidRequest as error:
        raise InvalidRequest(f"{field}{error.message.removeprefix('shader')}", field=field) from None


def _listed(targets: Any) -> list[TargetLike]:
    listed = list(targets) if hasattr(targets, "__iter__") else [targets]
    for target in listed:
        if not isinstance(target, (str, Target)):
            raise InvalidRequest(f"targets: {target!r} is neither a Target nor a text", field="targets")
    return listed


def _named(name: str, target: TargetLike, shader: Shader | None) -> Target:
    if not isinstance(target, str):
        return dataclasses.replace(target, name=name)
    try:
        return Target.parse(target, name, shader)
    except InvalidRequest as error:
        raise InvalidRequest(
            f"{name}: is no option, so it names a target, but {error.message}", field=error.field
        ) from None


def _targets(
    targets: Sequence[TargetLike] | TargetLike | None,
    named: Mapping[str, TargetLike],
    shader: Shader | None,
    result: kinds.ResultKind,
) -> tuple[Target, ...]:
    if isinstance(targets, (str, Target)):
        targets = [targets]
    if targets is not None:
        targets = _listed(targets)
    if targets is not None and named:
        raise InvalidRequest("targets: cannot be given together with targets by keyword", field="targets")
    if named:
        listed = [] if "mask" in named or result == "buckets" else [Target(name="mask")]
        for name, target in named.items():
            listed.append(_named(name, target, shader))
        if listed[0].name == "mask" and listed[0].shader is None:
            listed[0] = dataclasses.replace(listed[0], shader=Shader("occupancy"))
    elif targets is None:
        listed = [Target() if shader is None or shader.name == "occupancy" else Target(format="f32")]
    else:
        listed = [Target.parse(target, "", shader) if isinstance(target, str) else target for target in targets]
    if not 1 <= len(listed) <= _MAX_TARGETS:
        raise InvalidRequest(f"targets: {len(listed)} of them; 1 to {_MAX_TARGETS} are possible", field="targets")
    numbered = [
        target if target.name else dataclasses.replace(target, name=f"target{i}") for i, target in enumerate(listed)
    ]
    seen: set[str] = set()
    for target in numbered:
        if not target.name.isidentifier() or target.name.startswith("_") or target.name in seen:
            raise InvalidRequest(f"targets: the name '{target.name}' is used twice or not a name", field="targets")
        seen.add(target.name)
    return tuple(numbered)


@dataclasses.dataclass(frozen=True)
class Call:
    """What the options of a call ask for: a request, and how it is made."""

    request: Request
    together: Together | None  # None: of one mesh
    new_positions: Any
    server: ServerLike | None
    timeout: float | None
    progress: Progress


def call_options(
    *,
    resolution: int | None = None,
    voxel_size: kinds.PerAxis | None = None,
    dims: Sequence[int] | None = None,
    origin: Sequence[float] | None = None,
    like: "VoxelGrid | GridPlace | None" = None,
    fit: kinds.Fit = "tight",
    padding: int = 0,
    clip: "numpy.typing.ArrayLike | None" = None,
    axes: str | Sequence[str] | None = None,
    coverage: kinds.Coverage = "conservative",
    fill: kinds.Fill = "none",
    parts: kinds.PartScope = "whole",
    part_label: RulesLike = None,
    part_priority: RulesLike = None,
    exclude: str | Sequence[str] | None = None,
    targets: Sequence[TargetLike] | TargetLike | None = None,
    shader: ShaderLike | None = None,
    vertex_shader: ShaderLike | None = None,
    result: kinds.ResultKind = "dense",
    layout: kinds.Layout = "interleaved",
    backend: kinds.Backend = "auto",
    priority: kinds.Priority = "normal",
    compression: kinds.Compression = "none",
    packed_bits: bool = False,
    content_hash: bool = False,
    strict: bool = False,
    together: bool = False,
    transforms: "Sequence[TransformLike] | numpy.typing.NDArray[Any] | None" = None,
    names: Sequence[str | None] | None = None,
    labels: "Sequence[int | None] | numpy.typing.NDArray[Any] | None" = None,
    priorities: "Sequence[int | None] | numpy.typing.NDArray[Any] | None" = None,
    motions: Sequence[MotionLike] | None = None,
    new_positions: Any = None,
    server: ServerLike | None = None,
    timeout: float | None = None,
    progress: Progress = None,
    **named: TargetLike,
) -> Call:
    """The one list of the options of voxelize(), of every client (see voxelize()): the decorators of options.py give
    their signatures these.

    Errors: InvalidRequest naming the option; UnknownOption, a TypeError too, for a keyword that is none.
    """
    if named:
        check_target_names(named, call_options.__kwdefaults__)
    for name, target in named.items():
        if not isinstance(target, (str, Target)):
            raise UnknownOption(f"{name}: is no option; as the name of a target it takes a Target or a text", name)
    for name, switch in (("packed_bits", packed_bits), ("content_hash", content_hash), ("strict", strict)):
        if not isinstance(switch, bool):
            raise InvalidRequest(f"{name}: {switch!r} is neither True nor False", field=name)
    several = Together.of(
        together, transforms=transforms, names=names, labels=labels, priorities=priorities, motions=motions
    )
    default_shader = _shader(shader, "shader")
    listed = _targets(targets, named, default_shader, result)
    vertex = _shader(vertex_shader, "vertex_shader")
    if axes is not None:
        vertex = turned(axes, vertex)
    spec = request_pb2.VoxelizeSpec(
        grid=_grid(resolution, voxel_size, dims, origin, like, fit, padding, clip),
        coverage=_choice(request_pb2.Coverage, "COVERAGE", coverage, kinds.Coverage, "coverage"),
        fill=_choice(request_pb2.Fill, "FILL", fill, kinds.Fill, "fill"),
        parts=selection(parts, part_label, part_priority, exclude),
        vertex_shader=None if vertex is None else vertex.to_message(),
        targets=[target.to_message(default_shader) for target in listed],
        layout=_choice(request_pb2.Layout, "LAYOUT", layout, kinds.Layout, "layout"),
        result=_choice(request_pb2.ResultKind, "RESULT_KIND", result, kinds.ResultKind, "result"),
        strict=strict,
    )
    execution = request_pb2.Execution(
        backend=_choice(types.Backend, "BACKEND", backend, kinds.Backend, "backend"),
        priority=_choice(request_pb2.Priority, "PRIORITY", priority, kinds.Priority, "priority"),
    )
    delivery = request_pb2.Delivery(
        compression=_choice(request_pb2.Compression, "COMPRESSION", compression, kinds.Compression, "compression"),
        content_hash=content_hash,
    )
    message = request_pb2.VoxelizeRequest(spec=spec, execution=execution, delivery=delivery)
    request = Request(message, listed, packed_bits, content_hash)
    return Call(request, several, new_positions, server, checked_timeout(timeout), progress)
