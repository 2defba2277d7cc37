"""The option clip: the grid that fits a box in place of the mesh's. As FitGrid of core/grid/grid_spec.cpp."""
from __future__ import annotations

import math
from typing import Any, Sequence

import numpy
import numpy.typing

from .. import texts
from .._proto.voxelpipe.v1 import request_pb2
from .._proto.voxelpipe.v1 import types_pb2 as types
from ..errors import InvalidRequest

_MAX_AXIS = 1 << 20  # voxels
_MAX_VOXELS = 1 << 53
_MANY_VOXELS = 10**15  # an axis; larger counts are not computed
_TOO_SMALL = "grid.resolution: the mesh is too small for this many voxels"


def _wrong(why: str) -> InvalidRequest:
    return InvalidRequest(f"clip: {why}", field="clip")


def _numbers(clip: Any) -> tuple[str, list[float]]:
    """Also as a text, for errors."""
    if isinstance(clip, str):
        try:
            return clip, texts.parse_numbers(clip, ",")
        except texts.WrongText as error:
            raise _wrong(str(error)) from None
    try:
        array = numpy.asarray(clip, numpy.float64)
    except (TypeError, ValueError):
        raise _wrong(f"{clip!r} is neither six numbers nor two corners") from None
    if array.ndim > 1 and array.shape != (2, 3):
        raise _wrong(f"the shape is {array.shape}, expected (6,) or (2, 3)")
    numbers: list[float] = array.ravel().tolist()
    return ",".join(map(str, numbers)), numbers


def _box(clip: Any) -> tuple[list[float], list[float]]:
    """The least and the greatest corner. In: a text, six numbers or two corners. As ParseBox of core/request_text."""
    text, numbers = _numbers(clip)
    if len(numbers) != 6:
        raise _wrong(f"'{text}' has {len(numbers)} numbers; six expected, X0,Y0,Z0,X1,Y1,Z1")
    low, high = numbers[:3], numbers[3:]
    for axis, least, most in zip("xyz", low, high):
        if not (math.isfinite(least) and math.isfinite(most)):
            raise _wrong(f"'{text}' is not finite")
        if least >= most:
            state = "empty" if least == most else "inverted"
            raise _wrong(f"'{text}' is {state} along {axis}: the least corner comes first, then the greatest")
    return low, high


def _slack(low: float, high: float, size: float) -> float:
    return max(1e-9, min(4e-4, 2.0**-22 * max(abs(low), abs(high)) / size))


def _axis_voxels(voxels: float, slack: float) -> int:
    return math.ceil(min(max(voxels - slack, 1.0), _MANY_VOXELS))


def _centred(
    low: Sequence[float], extent: Sequence[float], dims: Sequence[int]
) -> tuple[Sequence[int], list[float], list[float]]:
    full = 0  # the axis that the box fills
    for axis in (1, 2):
        if extent[axis] / dims[axis] > extent[full] / dims[full]:
            full = axis
    room = [extent[full] * (dims[axis] / dims[full]) for axis in range(3)]
    origin = [low[axis] - (room[axis] - extent[axis]) / 2 for axis in range(3)]
    return dims, origin, [extent[full] / dims[full]] * 3


def _fitted(
    grid: request_pb2.GridRequest, low: list[float], high: list[float]
) -> tuple[Sequence[int], list[float], list[float]]:
    """dims, origin and voxel size, without padding."""
    extent = [most - least for least, most in zip(low, high)]
    longest = max(extent)
    if not math.isfinite(longest):
        raise _wrong("grid.resolution: the mesh's bounding box is not finite")
    form = grid.WhichOneof("form")
    voxels = grid.resolution.voxels
    if form == "dims":
        return _centred(low, extent, (grid.dims.x, grid.dims.y, grid.dims.z))
    if form == "resolution" and grid.resolution.fit == request_pb2.GRID_FIT_CUBE:
        return _centred(low, extent, (voxels, voxels, voxels))
    if form == "voxel_size":
        size = [grid.voxel_size.x, grid.voxel_size.y, grid.voxel_size.z]
        dims = [_axis_voxels(extent[axis] / size[axis], _slack(low[axis], high[axis], size[axis])) for axis in range(3)]
        return dims, low, size
    h = longest / voxels
    if h == 0:
        raise _wrong(_TOO_SMALL)
    dims = [
        voxels
        if extent[axis] == longest
        else _axis_voxels(extent[axis] / longest * voxels, _slack(low[axis], high[axis], h))
        for axis in range(3)
    ]
    return dims, low, [h] * 3


def clipped(grid: request_pb2.GridRequest, clip: "numpy.typing.ArrayLike") -> request_pb2.GridRequest:
    """The grid of a request, placed: it fits the box in place of the mesh's. Errors: InvalidRequest."""
    low, high = _box(clip)
    if grid.WhichOneof("form") == "placement":
        raise _wrong("dims and origin give a grid already; leave them out, or clip")
    if grid.resolution.voxels > _MAX_AXIS:
        raise _wrong(f"grid.resolution: {grid.resolution.voxels} is beyond {_MAX_AXIS} voxels an axis")
    if grid.padding > _MAX_AXIS:
        raise _wrong(f"grid.padding: must be at most {_MAX_AXIS}")
    fitted, corner, size = _fitted(grid, low, high)
    dims = [voxels + 2 * grid.padding for voxels in fitted]
    origin = [least - grid.padding * h for least, h in zip(corner, size)]
    for axis in range(3):
        if not 0 < size[axis] < math.inf:
            raise _wrong(_TOO_SMALL)
        if not math.isfinite(origin[axis]):
            raise _wrong("grid.origin: the grid's origin is not finite")
        if dims[axis] > _MAX_AXIS:
            count = str(dims[axis]) if dims[axis] < _MANY_VOXELS else "more than 10^15"
            raise _wrong(f"grid: {count} voxels along axis {axis}, at most {_MAX_AXIS} are possible")
    if math.prod(dims) > _MAX_VOXELS:
        raise _wrong(f"grid: {dims[0]} x {dims[1]} x {dims[2]} is beyond 2^53 voxels")
    placement = request_pb2.GridPlacement(
        dims=types.Dims(x=dims[0], y=dims[1], z=dims[2]),
        origin=types.Vec3(x=origin[0], y=origin[1], z=origin[2]),
        voxel_size=types.Vec3(x=size[0], y=size[1], z=size[2]),
    )
    return request_pb2.GridRequest(placement=placement)
