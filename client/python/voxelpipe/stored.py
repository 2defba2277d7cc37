"""Results of arrays: of a program's own, and of .npz files."""
from __future__ import annotations

import dataclasses
import errno
import math
import os
import zipfile
from typing import Any, Mapping, Sequence

import numpy
import numpy.typing

from . import names
from ._calls import part_arrays
from ._calls.reader import ResultReader, check_lists
from ._proto.voxelpipe.v1 import result_pb2
from ._proto.voxelpipe.v1 import types_pb2 as types
from .grid import VoxelGrid
from .options import make_request
from .place import GridPlace
from .request import per_axis
from .targets import Target

Array = numpy.typing.NDArray[Any]
_Spec = tuple[tuple[int, ...], "numpy.dtype[Any]"]  # shape and type of an array

_FORMATS: dict[str, names.Format] = {"b1": "bit", "u1": "u8", "u2": "u16", "u4": "u32", "f2": "f16", "f4": "f32"}
_PART_DTYPES = {"u64": "<i8", "i32": "<i4", "u32": "<u4", "u8": "u1"}
_PLACE = {"dims": ((3,), "iu"), "origin": ((3,), "fiu"), "voxel_size": ((3,), "fiu"), "index_to_world": ((4, 4), "fiu")}
_MAX_TARGETS = 8


@dataclasses.dataclass(frozen=True)
class _Values:
    """The values of a target: flat bytes in stream order, and their shape with the components, if any."""

    target: Target
    data: Array
    shape: tuple[int, ...]


def make_grid(
    arrays: Mapping[str, Any],
    *,
    voxel_size: names.PerAxis | None = None,
    origin: Sequence[float] | None = None,
    like: VoxelGrid | GridPlace | None = None,
) -> VoxelGrid:
    """A dense VoxelGrid of one's own arrays, which save(), show() and the converters take.

    arrays: of each target's name, (nz, ny, nx) or (nz, ny, nx, c), c 1 to 4, all of the same grid: bool (bits), uint8,
    uint16, uint32, float16 or float32. They are copied. voxel_size (default 1), origin (default 0): the place of the
    grid, origin its lowest corner; or that of another result by like. Errors: ValueError naming the array; TypeError.
    """
    if not isinstance(arrays, Mapping):
        raise TypeError("arrays: expected a dict of arrays by the names of their targets")
    if not arrays:
        raise ValueError("arrays: there is none")
    for name in arrays:
        if not isinstance(name, str) or not name.isidentifier() or name.startswith("_"):
            raise ValueError(f"arrays: {name!r} is no name of a target")
    taken = {name: numpy.asarray(array) for name, array in arrays.items()}
    first = next(iter(taken))
    shape = taken[first].shape[:3]
    if len(shape) != 3 or 0 in shape:
        raise ValueError(f"'{first}' has the shape {taken[first].shape}; expected (nz, ny, nx) or (nz, ny, nx, c)")
    if like is None:
        size = per_axis(1 if voxel_size is None else voxel_size, "voxel_size")
        corner = per_axis(0 if origin is None else origin, "origin")
        place = GridPlace((shape[2], shape[1], shape[0]), corner, size)
    elif voxel_size is not None or origin is not None:
        raise ValueError("like: gives the whole place; leave out voxel_size and origin")
    else:
        given: Any = getattr(like, "place", like)
        if not isinstance(given, GridPlace):
            raise TypeError(f"like: {like!r} is neither a VoxelGrid nor a GridPlace")
        place = given
    values = []
    for name, array in taken.items():
        _check_values(name, (array.shape, array.dtype), place.shape, False)
        values.append(_values(name, array, array.dtype.kind == "b"))
    return _made("dense", place, "interleaved", [], values, {})


def load_result(path: "str | os.PathLike[str]", *, layout: names.Layout | None = None) -> VoxelGrid:
    """The result in an .npz, of VoxelGrid.save() or of the command line: dense, sparse or buckets.

    layout: None: that which the shapes fit, interleaved where both do, as of three voxels with three components. A
    uint8 target of one component that holds zeros and ones alone comes back as bits: an .npz has them as bytes.
    The table of parts comes back too. Shaders, encodings and the summary's times are not in the file. Names, types and
    shapes are checked before values are read. Errors: OSError; ValueError for a file that is no .npz of a result.
    """
    name = os.fspath(path)
    try:
        with open(name, "rb") as file:
            if not zipfile.is_zipfile(file):
                raise ValueError("it is no zip archive")
            with zipfile.ZipFile(file) as archive:
                return _loaded(archive, layout)
    except Exception as error:  # of a broken archive: of zipfile, zlib, tokenize, numpy, ...
        if isinstance(error, OSError) and error.errno != errno.EINVAL:  # EINVAL: it names a place before its first byte
            raise
        why = str(error).replace("the server's answer: ", "").replace("the server's result: ", "")
        raise ValueError(f"{name}: no .npz of a result: {why or type(error).__name__}") from None


def _loaded(archive: zipfile.ZipFile, layout: names.Layout | None) -> VoxelGrid:
    specs = {entry.removesuffix(".npy"): _spec_of(archive, entry) for entry in archive.namelist()}
    kind: names.ResultKind = "dense"
    lists: dict[str, tuple[tuple[int, ...], str]] = {}
    if "ijk" in specs:
        kind = "buckets" if "offsets" in specs else "sparse"
        count = specs["ijk"][0][0] if specs["ijk"][0] else 0
        lists = {"ijk": ((count, 3), "iu")}
        if kind == "buckets":
            fragments = math.prod(specs.get("triangle", ((0,), None))[0])
            lists |= {"offsets": ((count + 1,), "iu"), "triangle": ((fragments,), "iu")}
    wanted = {key: spec for key, spec in _PLACE.items() if key in specs or key != "index_to_world"} | lists
    for key, (shape, kinds) in wanted.items():
        if key not in specs:
            raise ValueError(f"it lacks '{key}'")
        if specs[key][0] != shape or specs[key][1].kind not in kinds:
            raise ValueError(f"'{key}' is an array of {specs[key][1]} of the shape {specs[key][0]}; expected {shape}")
    parts = _part_specs(specs)
    targets = {key: spec for key, spec in specs.items() if key not in wanted and key not in parts}
    if not 1 <= len(targets) <= _MAX_TARGETS:
        raise ValueError(f"it has {len(targets)} targets; 1 to {_MAX_TARGETS} are possible")
    place = _place_of({key: _read(archive, key) for key in _PLACE if key in specs})
    base = {"dense": place.shape, "sparse": lists.get("ijk", ((), ""))[0][:1]}.get(
        kind, lists.get("triangle", ((), ""))[0]
    )
    planar = layout == "planar" or (layout is None and any(_is_planar(spec[0], base) for spec in targets.values()))
    for key, spec in targets.items():
        _check_values(key, spec, base, planar)
    arrays = {key: _read(archive, key) for key in [*lists, *targets]}
    listed: list[Array] = []
    order: Array | None = None
    if kind == "sparse":
        listed, order = _bricks(place, _inside(place, arrays["ijk"]))
    elif kind == "buckets":
        ijk = _inside(place, arrays["ijk"])
        voxel = ijk[:, 0] + place.dims[0] * (ijk[:, 1] + place.dims[1] * ijk[:, 2])
        listed = [voxel.astype("<u8"), arrays["offsets"].astype("<u8"), arrays["triangle"].astype("<u4")]
    values = []
    for key in targets:
        array = arrays[key]
        if order is not None:
            array = array[..., order] if planar else array[order]
        values.append(_values(key, array, _is_bits(array, base)))
    table = {key: _read(archive, key) for key in parts}
    return _made(kind, place, "planar" if planar else "interleaved", listed, values, table)


def _part_specs(specs: Mapping[str, _Spec]) -> list[str]:
    """The arrays of parts in a file, in stream order. Errors: ValueError naming one that is missing or another."""
    if "part_label" not in specs:
        return []
    wanted = part_arrays.names_of("part_voxels" in specs)
    sizes = [math.prod(specs.get(name, ((0,), None))[0]) for name in ("part_label", "part_name")]
    for name, shape in part_arrays.shapes_of(wanted, *sizes).items():
        if name not in specs:
            raise ValueError(f"it lacks '{name}'")
        dtype = numpy.dtype(_PART_DTYPES[part_arrays.ELEMENTS[name]])
        if specs[name] != (shape, dtype):
            found = f"'{name}' is an array of {specs[name][1]} of the shape {specs[name][0]}"
            raise ValueError(f"{found}; expected {dtype} of {shape}")
    return wanted


def _spec_of(archive: zipfile.ZipFile, entry: str) -> _Spec:
    if not entry.endswith(".npy") or entry == ".npy":
        raise ValueError(f"its entry '{entry}' is no array")
    form: Any = numpy.lib.format
    with archive.open(entry) as file:
        version = form.read_magic(file)
        read = form.read_array_header_1_0 if version == (1, 0) else form.read_array_header_2_0
        shape, _, dtype = read(file)
    return tuple(shape), dtype


def _read(archive: zipfile.ZipFile, key: str) -> Array:
    read: Any = numpy.lib.format.read_array
    with archive.open(f"{key}.npy") as file:
        array: Array = read(file, allow_pickle=False)
    return array


def _place_of(arrays: dict[str, Array]) -> GridPlace:
    x, y, z = (int(axis) for axis in arrays["dims"])
    corner, size = (tuple(float(number) for number in arrays[key]) for key in ("origin", "voxel_size"))
    place = GridPlace((x, y, z), corner, size)  # type: ignore[arg-type]
    if "index_to_world" in arrays and not numpy.allclose(arrays["index_to_world"], place.index_to_world, rtol=1e-9):
        raise ValueError("'index_to_world' is not that of dims, origin and voxel_size")
    return place


def _inside(place: GridPlace, ijk: Array) -> Array:
    if not bool(place.inside(ijk).all()):
        raise ValueError(f"'ijk' names voxels outside of the grid {place.dims}")
    return ijk.astype(numpy.int64)


def _bricks(place: GridPlace, ijk: Array) -> tuple[list[Array], Array]:
    """The lists of a sparse result, and the order of its voxels: by brick, then by bit."""
    nx, ny, _ = ((axis + 7) // 8 for axis in place.dims)
    ids = (ijk[:, 0] >> 3) + nx * ((ijk[:, 1] >> 3) + ny * (ijk[:, 2] >> 3))
    bits = (ijk[:, 0] & 7) + 8 * (ijk[:, 1] & 7) + 64 * (ijk[:, 2] & 7)
    order: Array = numpy.lexsort((bits, ids))
    brick, row = numpy.unique(ids[order], return_inverse=True)
    mask = numpy.zeros((len(brick), 512), numpy.uint8)
    mask[row, bits[order]] = 1
    if int(mask.sum(dtype=numpy.int64)) != len(ijk):
        raise ValueError("'ijk' names a voxel twice")
    return [brick.astype("<u8"), numpy.packbits(mask, axis=1, bitorder="little")], order


def _is_planar(shape: tuple[int, ...], base: tuple[int, ...]) -> bool:
    return len(shape) == len(base) + 1 and shape[:-1] != base and shape[1:] == base


def _check_values(name: str, spec: _Spec, base: tuple[int, ...], planar: bool) -> None:
    shape, dtype = spec
    if dtype.str[1:] not in _FORMATS:
        known = "bool, uint8, uint16, uint32, float16 or float32"
        raise ValueError(f"'{name}' is an array of {dtype}; expected {known}")
    components = 1 if shape == base or not shape else shape[0] if planar else shape[-1]
    whole = (components, *base) if planar else (*base, components)
    if not (shape == base or shape == whole) or not 1 <= components <= 4:
        raise ValueError(f"'{name}' has the shape {shape}; expected {base}, or with 1 to 4 components")


def _is_bits(array: Array, base: tuple[int, ...]) -> bool:
    return array.dtype.kind == "b" or (array.dtype == numpy.uint8 and array.shape == base and not (array > 1).any())


def _values(name: str, array: Array, bits: bool) -> _Values:
    ordered = numpy.ascontiguousarray(array, array.dtype.newbyteorder("<")).reshape(-1)
    data = numpy.packbits(ordered, bitorder="little") if bits else ordered.view(numpy.uint8).copy()
    return _Values(Target(format="bit" if bits else _FORMATS[array.dtype.str[1:]], name=name), data, array.shape)


def _made(
    kind: names.ResultKind,
    place: GridPlace,
    layout: names.Layout,
    lists: list[Array],
    values: list[_Values],
    parts: Mapping[str, Array],
) -> VoxelGrid:
    base = len(place.shape) if kind == "dense" else 1
    for number, value in enumerate(values):
        components = 1 if len(value.shape) == base else value.shape[0 if layout == "planar" else -1]
        values[number] = dataclasses.replace(value, target=dataclasses.replace(value.target, components=components))
    request = make_request(
        dims=place.dims,
        origin=place.origin_corner,
        voxel_size=place.voxel_size,
        targets=[value.target for value in values],
        result=kind,
        layout=layout,
        # Which sets of triangles the parts are, and how they were filled, is not known: any that have these arrays.
        parts="node" if parts else "whole",
        fill="parity" if "part_voxels" in parts else "none",
    )
    header = result_pb2.ResultHeader(
        grid=types.Grid(
            dims=types.Dims(x=place.dims[0], y=place.dims[1], z=place.dims[2]),
            origin=_vec3(place.origin_corner),
            voxel_size=_vec3(place.voxel_size),
            index_to_world=place.index_to_world.reshape(-1).tolist(),
        ),
        spec=request.spec,
    )
    listed = {"sparse": ("brick", "mask"), "buckets": ("voxel", "offset", "triangle")}.get(kind, ())
    elements = {"u8": "U64", "u4": "U32", "u1": "U8"}
    for name, array in zip(listed, lists):
        header.arrays.add(name=name, element_type=f"ELEMENT_TYPE_{elements[array.dtype.str[1:]]}", shape=array.shape)
    for number, value in enumerate(values):
        element = f"ELEMENT_TYPE_{value.target.format.upper()}"
        header.arrays.add(name=f"target{number}", element_type=element, shape=value.shape)
    for name, array in parts.items():
        element = f"ELEMENT_TYPE_{part_arrays.ELEMENTS[name].upper()}"
        header.arrays.add(name=name, element_type=element, shape=array.shape)
    flat = [array.reshape(-1).view(numpy.uint8) for array in lists] + [value.data for value in values]
    flat += [array.view(numpy.uint8) for array in parts.values()]
    reader = ResultReader(request, max_result_bytes=1 << 63, request_id="", report=None)
    summary = result_pb2.Summary(result_bytes=sum(array.nbytes for array in flat))
    grid = reader.taken_over(header.SerializeToString(), flat, summary.SerializeToString())
    count = grid.array.shape[-1 if layout == "planar" else 0] if kind == "sparse" else 0
    check_lists(kind, place, grid.lists, count)
    return dataclasses.replace(grid, summary=dataclasses.replace(grid.summary, occupied=_occupied(grid)))


def _vec3(vector: tuple[float, float, float]) -> types.Vec3:
    return types.Vec3(x=vector[0], y=vector[1], z=vector[2])


def _occupied(grid: VoxelGrid) -> int:
    """Occupied voxels; of a dense result without bits those whose value is not 0."""
    if grid.kind != "dense":
        return len(grid.occupied())
    bits = [target.name for target in grid.targets if target.format == "bit"]
    array = grid[bits[0]] if bits else grid.array
    if array.shape != grid.place.shape:
        array = array.any(axis=0 if grid.layout == "planar" else -1)
    return int(numpy.count_nonzero(array))
