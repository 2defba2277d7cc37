"""Results of arrays: of a program's own, and of .npz files."""
from __future__ import annotations

import dataclasses
import os
import zipfile
from typing import Any, Mapping, Sequence

import numpy
import numpy.typing

from . import names
from ._calls.reader import ResultReader, check_lists
from ._proto.voxelpipe.v1 import types_pb2 as types
from ._proto.voxelpipe.v1 import voxelization_service_pb2 as service
from .errors import DataLoss, InvalidRequest
from .grid import VoxelGrid
from .options import make_request
from .place import GridPlace
from .targets import Target

Array = numpy.typing.NDArray[Any]

_FORMATS: dict[str, names.Format] = {"b1": "bit", "u1": "u8", "u2": "u16", "u4": "u32", "f2": "f16", "f4": "f32"}
_PLACE = ("dims", "origin", "voxel_size", "index_to_world")
_LISTS = ("ijk", "offsets", "triangle")


@dataclasses.dataclass(frozen=True)
class _Values:
    """The values of a target: flat bytes in stream order, and their shape with the components, if any."""

    target: Target
    data: Array
    shape: tuple[int, ...]


def make_grid(
    arrays: Mapping[str, Any],
    *,
    voxel_size: names.PerAxis = 1.0,
    origin: Sequence[float] = (0.0, 0.0, 0.0),
    like: VoxelGrid | GridPlace | None = None,
) -> VoxelGrid:
    """A dense VoxelGrid of one's own arrays, which save(), show() and the converters take.

    arrays: of each target's name, (nz, ny, nx) or (nz, ny, nx, c), c 1 to 4, all of the same grid: bool (bits), uint8,
    uint16, uint32, float16 or float32. They are copied. voxel_size, origin: the place of the grid, origin its lowest
    corner; or that of another result by like. Errors: ValueError naming the array.
    """
    if not arrays:
        raise ValueError("arrays: there is none")
    taken = {name: numpy.asarray(array) for name, array in arrays.items()}
    shape = next(iter(taken.values())).shape[:3]
    if len(shape) != 3 or 0 in shape:
        raise ValueError(f"arrays: '{next(iter(taken))}' has the shape {shape}; expected (nz, ny, nx) or one more")
    if like is not None:
        place = like.place if isinstance(like, VoxelGrid) else like
    else:
        sizes = tuple(float(size) for size in numpy.broadcast_to(numpy.asarray(voxel_size, float), 3))
        corner = tuple(float(number) for number in origin)
        place = GridPlace((shape[2], shape[1], shape[0]), corner, sizes)  # type: ignore[arg-type]
    return _made("dense", place, "interleaved", [], [_values(name, a, place.shape, False) for name, a in taken.items()])


def load_result(path: "str | os.PathLike[str]") -> VoxelGrid:
    """The result in an .npz, of VoxelGrid.save() or of the command line: dense, sparse or buckets.

    A uint8 target of one component that holds zeros and ones alone comes back as bits: an .npz has them as bytes.
    Shaders, encodings and the summary's times are not in the file. Errors: OSError; ValueError for a file that is no
    .npz of a result.
    """
    name = os.fspath(path)
    try:
        loaded = numpy.load(name, allow_pickle=False)
        if not isinstance(loaded, numpy.lib.npyio.NpzFile):
            raise ValueError("it is a single array")
        with loaded as file:
            arrays = {key: file[key] for key in file.files}
        for key, array in arrays.items():
            if not isinstance(array, numpy.ndarray) or array.ndim == 0:
                raise ValueError(f"'{key}' is no array")
        return _loaded(arrays)
    except (ValueError, KeyError, EOFError, zipfile.BadZipFile, InvalidRequest, DataLoss) as error:
        raise ValueError(f"{name}: no .npz of a result: {error}") from None


def _loaded(arrays: dict[str, Array]) -> VoxelGrid:
    for key in _PLACE[:3]:
        if arrays.get(key, numpy.zeros(0)).shape != (3,):
            raise ValueError(f"it lacks '{key}' of three numbers")
    x, y, z = (int(axis) for axis in arrays["dims"])
    corner, size = (tuple(float(number) for number in arrays[key]) for key in ("origin", "voxel_size"))
    place = GridPlace((x, y, z), corner, size)  # type: ignore[arg-type]
    targets = {key: array for key, array in arrays.items() if key not in _PLACE and key not in _LISTS}
    if not targets:
        raise ValueError("it has no target")
    if "ijk" not in arrays:
        planar = any(a.shape[:3] != place.shape and a.shape[1:] == place.shape for a in targets.values())
        layout: names.Layout = "planar" if planar else "interleaved"
        return _made("dense", place, layout, [], [_values(n, a, place.shape, True, planar) for n, a in targets.items()])
    ijk = arrays["ijk"].astype(numpy.int64)
    if ijk.ndim != 2 or ijk.shape[1] != 3 or not bool(place.inside(ijk).all()):
        raise ValueError(f"ijk of the shape {ijk.shape} names no voxels of the grid {place.dims}")
    if "offsets" in arrays:
        return _buckets(place, ijk, arrays, targets)
    return _sparse(place, ijk, targets)


def _sparse(place: GridPlace, ijk: Array, targets: dict[str, Array]) -> VoxelGrid:
    nx, ny, _ = ((axis + 7) // 8 for axis in place.dims)
    ids = (ijk[:, 0] >> 3) + nx * ((ijk[:, 1] >> 3) + ny * (ijk[:, 2] >> 3))
    bits = (ijk[:, 0] & 7) + 8 * (ijk[:, 1] & 7) + 64 * (ijk[:, 2] & 7)
    order = numpy.lexsort((bits, ids))
    brick, row = numpy.unique(ids[order], return_inverse=True)
    mask = numpy.zeros((len(brick), 512), numpy.uint8)
    mask[row, bits[order]] = 1
    if int(mask.sum(dtype=numpy.int64)) != len(ijk):
        raise ValueError("ijk names a voxel twice")
    lists = [brick.astype("<u8"), numpy.packbits(mask, axis=1, bitorder="little")]
    planar = _is_planar(targets, len(ijk))
    values = []
    for name, array in targets.items():
        by_components = planar and array.ndim == 2
        if array.shape[1 if by_components else 0] != len(ijk):
            raise ValueError(f"'{name}' has the shape {array.shape}; expected values of {len(ijk)} voxels")
        ordered = array[:, order] if by_components else array[order]
        values.append(_values(name, ordered, (len(ijk),), True, planar))
    return _made("sparse", place, "planar" if planar else "interleaved", lists, values)


def _buckets(place: GridPlace, ijk: Array, arrays: dict[str, Array], targets: dict[str, Array]) -> VoxelGrid:
    voxel = ijk[:, 0] + place.dims[0] * (ijk[:, 1] + place.dims[1] * ijk[:, 2])
    lists = [voxel.astype("<u8"), arrays["offsets"].astype("<u8"), arrays["triangle"].astype("<u4")]
    count = len(lists[2])
    planar = _is_planar(targets, count)
    values = [_values(name, array, (count,), True, planar) for name, array in targets.items()]
    return _made("buckets", place, "planar" if planar else "interleaved", lists, values)


def _is_planar(targets: dict[str, Array], count: int) -> bool:
    return any(array.ndim == 2 and array.shape[0] != count for array in targets.values())


def _values(name: str, array: Array, base: tuple[int, ...], stored: bool, planar: bool = False) -> _Values:
    kind = array.dtype.newbyteorder("=").str[1:]
    if kind not in _FORMATS:
        known = "bool, uint8, uint16, uint32, float16 or float32"
        raise ValueError(f"'{name}' is an array of {array.dtype}; expected {known}")
    extra = array.shape[:1] if planar else array.shape[len(base) :]
    whole = (*extra, *base) if planar else (*base, *extra)
    if array.shape != base and (array.ndim != len(base) + 1 or array.shape != whole or not 1 <= extra[0] <= 4):
        raise ValueError(f"'{name}' has the shape {array.shape}; expected {base}, or with 1 to 4 components")
    components = extra[0] if array.ndim > len(base) else 1
    bits = kind == "b1" or (stored and kind == "u1" and array.shape == base and not bool((array > 1).any()))
    target = Target(format="bit" if bits else _FORMATS[kind], components=components, name=name)
    ordered = numpy.ascontiguousarray(array, array.dtype.newbyteorder("<")).reshape(-1)
    data = numpy.packbits(ordered, bitorder="little") if bits else ordered.view(numpy.uint8).copy()
    return _Values(target, data, array.shape)


def _made(
    kind: names.ResultKind, place: GridPlace, layout: names.Layout, lists: list[Array], values: list[_Values]
) -> VoxelGrid:
    request = make_request(
        dims=place.dims,
        origin=place.origin_corner,
        voxel_size=place.voxel_size,
        targets=[value.target for value in values],
        result=kind,
        layout=layout,
    )
    header = service.ResultHeader(
        grid=types.Grid(
            dims=types.Dims(x=place.dims[0], y=place.dims[1], z=place.dims[2]),
            origin=_vec3(place.origin_corner),
            voxel_size=_vec3(place.voxel_size),
            index_to_world=place.index_to_world.reshape(-1).tolist(),
        ),
        layout=request.config.layout,
        kind=request.config.result,
    )
    listed = {"sparse": ("brick", "mask"), "buckets": ("voxel", "offset", "triangle")}.get(kind, ())
    elements = {"u8": "U64", "u4": "U32", "u1": "U8"}
    for name, array in zip(listed, lists):
        header.arrays.add(name=name, element_type=f"ELEMENT_TYPE_{elements[array.dtype.str[1:]]}", shape=array.shape)
    for number, value in enumerate(values):
        element = f"ELEMENT_TYPE_{value.target.format.upper()}"
        header.arrays.add(name=f"target{number}", element_type=element, shape=value.shape)
    flat = [array.reshape(-1).view(numpy.uint8) for array in lists] + [value.data for value in values]
    reader = ResultReader(request, max_result_bytes=1 << 63, request_id="", report=None)
    summary = service.Summary(result_bytes=sum(array.nbytes for array in flat))
    grid = reader.taken_over(header.SerializeToString(), flat, summary.SerializeToString())
    check_lists(kind, place, grid.lists, len(grid.array) if kind == "sparse" else 0)
    return dataclasses.replace(grid, summary=dataclasses.replace(grid.summary, occupied=_occupied(grid)))


def _vec3(vector: tuple[float, float, float]) -> types.Vec3:
    return types.Vec3(x=vector[0], y=vector[1], z=vector[2])


def _occupied(grid: VoxelGrid) -> int:
    """Occupied voxels; of a dense result without bits those whose value is not 0."""
    if grid.kind != "dense":
        return len(grid.occupied())
    bits = [target.name for target in grid.targets if target.format == "bit"]
    if bits:
        return int(numpy.count_nonzero(grid[bits[0]]))
    array = grid.array
    axis = () if array.shape == grid.place.shape else (0,) if grid.layout == "planar" else (-1,)
    return int(numpy.count_nonzero(array.any(axis=axis) if axis else array))
