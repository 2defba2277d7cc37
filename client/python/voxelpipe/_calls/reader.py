"""Reads the responses of one call into a VoxelGrid: checks every piece, and puts its bytes where they belong."""
from __future__ import annotations

import hashlib
import math
from typing import Any, Callable, Sequence

import numpy
import numpy.typing

from .._proto.voxelpipe.v1 import request_pb2, result_pb2
from .._proto.voxelpipe.v1 import types_pb2 as types
from ..device import DeviceArray, DeviceGrid
from ..errors import MissingPackage, TooLarge
from ..grid import VoxelGrid
from ..part_table import Parts
from ..place import GridPlace
from ..report import Summary, read_place, read_warnings
from ..request import Request
from ..targets import DTYPES
from .crc32c import crc32c
from .destination import LIST_DTYPES, Destination, memory_bytes, wire_bytes
from .part_arrays import check_shapes, expected_names, read_parts
from .wire import Piece, lost, parsed, read_pieces

Report = Callable[[str, float, int], None]

_MAX_UNCOMPRESSED_BYTES = 64 << 20  # of one compressed piece
_MAX_FRAGMENTS = 1 << 53
_MAX_DIMENSIONS = 4  # nz, ny, nx, components
_BRICKS_AT_ONCE = 1 << 14
_KINDS: dict[int, str] = {
    request_pb2.RESULT_KIND_DENSE: "dense",
    request_pb2.RESULT_KIND_SPARSE: "sparse",
    request_pb2.RESULT_KIND_BUCKETS: "buckets",
}
_LISTS = {"dense": (), "sparse": ("brick", "mask"), "buckets": ("voxel", "offset", "triangle")}
_LIST_TYPES = {"brick": "u64", "mask": "u8", "voxel": "u64", "offset": "u64", "triangle": "u32"}
_ELEMENTS: dict[int, str] = {
    value: name.removeprefix("ELEMENT_TYPE_").lower() for name, value in types.ElementType.items()
}
_DEVICE_DTYPES = {**DTYPES, "bit": numpy.dtype("u1")}  # bits stay eight a byte

Array = numpy.typing.NDArray[Any]


def _taken_over(element: str, shape: tuple[int, ...], unpack: bool, data: Array) -> Array:
    """A flat array of bytes as what it is, without a copy but of bits that become bools. Errors: DataLoss."""
    if data.nbytes != wire_bytes(element, shape):
        raise lost(f"an array of {data.nbytes} bytes, {element} of shape {shape}")
    if element == "bit":
        count = math.prod(shape)
        bits = numpy.unpackbits(data, count=count, bitorder="little") if unpack else data
        return bits.view(numpy.bool_).reshape(shape) if unpack else data
    return data.view(LIST_DTYPES.get(element) or DTYPES[element]).reshape(shape)


class ResultReader:
    """The result of one call. In: the request, the largest result that is taken, and who hears of progress."""

    def __init__(self, request: Request, max_result_bytes: int, request_id: str, report: Report | None) -> None:
        self._request = request
        self._max_result_bytes = max_result_bytes
        self._request_id = request_id
        self._report = report
        self._place: GridPlace | None = None
        self._kind = ""
        self._parts: list[str] = []  # the arrays of parts, which come last
        self._header = b""
        self._names: list[str] = []
        self._arrays: list[Destination] = []
        self._array = self._offset = self._received = self._total = 0
        self._values = 0  # of sparse results, as announced
        self._planned = False
        self._summary: result_pb2.Summary | None = None
        self._hash = hashlib.sha256() if request.content_hash else None

    def add_bytes(self, message: bytes) -> None:
        """A VoxelizeResponse, encoded. Errors: DataLoss, TooLarge."""
        pieces = read_pieces(message)
        if pieces is None:
            self.add(parsed(result_pb2.VoxelizeResponse, message))
            return
        for piece in pieces:
            self._add_piece(piece)

    @property
    def complete(self) -> bool:
        """True if the summary has come, the last part of a result."""
        return self._summary is not None

    def add(self, response: result_pb2.VoxelizeResponse) -> None:
        """A VoxelizeResponse: any parts of a result, in their order. Errors: DataLoss, TooLarge."""
        if self.complete:
            raise lost("a message after its summary")
        if response.HasField("plan"):
            self._add_plan(response.plan)
        if response.HasField("progress"):
            self._add_progress(response.progress)
        if response.HasField("header"):
            self._add_header(response.header)
        for piece in response.pieces:
            self._add_piece(Piece.of(piece))
        if response.HasField("summary"):
            self._add_summary(response.summary)

    def taken_over(self, header: bytes, arrays: Sequence[Array], summary: bytes) -> VoxelGrid:
        """A result that was made in this process: ResultHeader, flat bytes of each array, Summary. Errors: DataLoss."""
        specs = self._read_header(result_pb2.ResultHeader.FromString(header))
        self._header = header
        if len(specs) != len(arrays):
            raise lost(f"{len(arrays)} arrays, announced were {len(specs)}")
        unpack = not self._request.packed_bits
        taken = [_taken_over(element, shape, unpack, data) for (element, shape), data in zip(specs, arrays)]
        return self._grid(taken, result_pb2.Summary.FromString(summary))

    def taken_on_device(self, header: bytes, buffers: Sequence[Any], summary: bytes) -> DeviceGrid:
        """A dense result whose targets are voxelpipe_core.DeviceBuffer objects. Errors: DataLoss."""
        specs = self._read_header(result_pb2.ResultHeader.FromString(header))
        # Each has a `size` in bytes: the targets are on the device, the arrays of parts are not.
        if [buffer.size for buffer in buffers] != [wire_bytes(element, shape) for element, shape in specs]:
            raise lost("arrays of other sizes than announced")
        assert self._place is not None
        message = result_pb2.Summary.FromString(summary)
        arrays = {
            target.name: DeviceArray(buffer, shape if element != "bit" else (buffer.size,), _DEVICE_DTYPES[element])
            for target, buffer, (element, shape) in zip(self._request.targets, buffers, specs)
        }
        others = list(zip(specs, buffers))[len(arrays) :]
        parts = [_taken_over(element, shape, False, data) for (element, shape), data in others]
        return DeviceGrid(
            place=self._place,
            targets=self._request.targets,
            arrays=arrays,
            warnings=read_warnings(message),
            summary=Summary.of(message, self._request_id),
            parts=self._table(parts),
        )

    def finish(self) -> VoxelGrid:
        """The result. Errors: DataLoss if anything of it is missing."""
        if self._summary is None or self._place is None:
            raise lost("it ended before its summary")
        lists = {name: self._arrays[i].array for i, name in enumerate(_LISTS[self._kind])}
        check_lists(self._kind, self._place, lists, self._values)
        return self._grid([destination.array for destination in self._arrays], self._summary)

    def _grid(self, arrays: list[Array], summary: result_pb2.Summary) -> VoxelGrid:
        assert self._place is not None
        lists = dict(zip(_LISTS[self._kind], arrays))
        return VoxelGrid(
            kind=self._kind,  # type: ignore[arg-type]
            place=self._place,
            layout="planar" if self._request.spec.layout == request_pb2.LAYOUT_PLANAR else "interleaved",
            targets=self._request.targets,
            stored={target.name: arrays[len(lists) + i] for i, target in enumerate(self._request.targets)},
            lists=lists,
            parts=self._table(arrays[len(lists) + len(self._request.targets) :]),
            packed_bits=self._request.packed_bits,
            warnings=read_warnings(summary),
            summary=Summary.of(summary, self._request_id),
            _request=self._request.encoded,
            _header=self._header,
        )

    def _table(self, arrays: Sequence[Array]) -> Parts | None:
        """In: the arrays of parts. Errors: DataLoss."""
        return read_parts(dict(zip(self._parts, arrays)))

    def _add_plan(self, plan: result_pb2.VoxelizationPlan) -> None:
        if self._planned:
            raise lost("a second plan")
        if self._place is not None:
            raise lost("a plan after the header")
        if min(plan.result_bytes, plan.peak_bytes) < 0:
            raise lost("a plan of a negative size")
        read_place(plan.grid)
        self._planned = True

    def _add_progress(self, progress: result_pb2.Progress) -> None:
        if math.isnan(progress.fraction):
            raise lost("a progress that is no number")
        if self._report:
            self._report(progress.stage, progress.fraction, self._received)

    def _add_header(self, header: result_pb2.ResultHeader) -> None:
        specs = self._read_header(header)
        self._header = header.SerializeToString()
        unpack = not self._request.packed_bits
        self._arrays = [Destination(element, shape, unpack) for element, shape in specs]

    def _read_header(self, header: result_pb2.ResultHeader) -> list[tuple[str, tuple[int, ...]]]:
        """Element and shape of each array. Errors: DataLoss, TooLarge."""
        if self._place is not None:
            raise lost("a second header")
        place = read_place(header.grid)
        self._check_grid(place)
        asked, made = self._request.spec, header.spec
        if made.result != asked.result:
            raise lost(f"a result of kind {made.result}, requested was {asked.result}")
        if made.layout != asked.layout:
            raise lost(f"a result of layout {made.layout}, requested was {asked.layout}")
        self._kind = _KINDS[asked.result]
        specs = self._expected(header, place)
        self._total = sum(wire_bytes(element, shape) for element, shape in specs)
        unpack = not self._request.packed_bits
        needed = sum(memory_bytes(element, shape, unpack) for element, shape in specs)
        if needed > self._max_result_bytes:
            raise TooLarge(
                f"the result has {needed} bytes in memory, this client takes {self._max_result_bytes} "
                "(max_result_bytes)",
                need_bytes=needed,
                limit_bytes=self._max_result_bytes,
            )
        self._place = place
        return specs

    def _expected(self, header: result_pb2.ResultHeader, place: GridPlace) -> list[tuple[str, tuple[int, ...]]]:
        """Element and shape of each array, checked against the request and the grid."""
        lists = _LISTS[self._kind]
        names = [*lists, *(f"target{i}" for i in range(len(self._request.targets)))]
        others = len(names)
        self._parts = expected_names(self._request, len(header.arrays), others)
        names += self._parts
        if len(header.arrays) != len(names):
            raise lost(f"{len(header.arrays)} arrays instead of {len(names)}")
        for name, array in zip(names, header.arrays):
            if array.name != name:
                raise lost(f"an array that is not '{name}' in its place")
            if not 1 <= len(array.shape) <= _MAX_DIMENSIONS:
                raise lost(f"its array {name} has a shape of {len(array.shape)} numbers")
            if min(array.shape) < 0:
                raise lost(f"its array {name} has a shape of {min(array.shape)} elements")
        elements = [_element(array.element_type) for array in header.arrays]
        shapes = [tuple(int(axis) for axis in array.shape) for array in header.arrays]
        planar = self._request.spec.layout == request_pb2.LAYOUT_PLANAR
        *listed, base = _counted(self._kind, shapes, planar, place)
        for i, name in enumerate(lists):
            if elements[i] != _LIST_TYPES[name] or shapes[i] != listed[i]:
                raise lost(f"its array {name} is {elements[i]} of shape {shapes[i]}")
        self._values = base[0]
        check_shapes(self._parts, elements[others:], shapes[others:])
        for i, target in enumerate(self._request.targets):
            element, shape = elements[len(lists) + i], shapes[len(lists) + i]
            extra = [shape[0] if planar else shape[-1]] if len(shape) == len(base) + 1 else []
            whole = (*extra, *base) if planar else (*base, *extra)
            components = extra[0] if extra else 1
            if element != target.format or shape != whole or not 1 <= components <= 4:
                raise lost(f"its array target{i} is {element} of shape {shape}")
            if target.components not in (None, components):
                raise lost(f"its array target{i} has {components} components, requested were {target.components}")
        return list(zip(elements, shapes))

    def _check_grid(self, place: GridPlace) -> None:
        grid = self._request.spec.grid
        form = grid.WhichOneof("form")
        padding = 2 * grid.padding
        given: Any = grid.placement if form == "placement" else grid
        if form == "resolution":
            voxels = grid.resolution.voxels
            if max(place.dims) > voxels + padding:
                raise lost(f"its dims are {place.dims}, requested was resolution {voxels}, padding {grid.padding}")
        if form in ("dims", "placement"):
            wanted = tuple(axis + padding for axis in (given.dims.x, given.dims.y, given.dims.z))
            if place.dims != wanted:
                raise lost(f"its dims are {place.dims}, requested were {wanted}")
        if form in ("voxel_size", "placement"):
            size = given.voxel_size
            if place.voxel_size != (size.x, size.y, size.z):
                raise lost("its voxel size is not the requested one")

    def _add_piece(self, piece: Piece) -> None:
        if self._place is None:
            raise lost("a piece before the header")
        if not piece.data:
            raise lost("a piece without bytes")
        while self._array < len(self._arrays) and self._offset == self._arrays[self._array].wire_bytes:
            self._array += 1
            self._offset = 0
        if self._array == len(self._arrays):
            raise lost("more bytes than announced")
        if (piece.array, piece.offset) != (self._array, self._offset):
            raise lost(
                f"a piece of array {piece.array} at offset {piece.offset}, expected was array {self._array} at "
                f"{self._offset}"
            )
        destination = self._arrays[self._array]
        compressed = piece.uncompressed_bytes is not None
        size = len(piece.data) if piece.uncompressed_bytes is None else piece.uncompressed_bytes
        if size < 1:
            raise lost(f"a compressed piece of {size} bytes")
        if size > destination.wire_bytes - self._offset or (compressed and size > _MAX_UNCOMPRESSED_BYTES):
            raise lost(f"a piece of {size} bytes at offset {self._offset} of array {self._array} is too long")
        if crc32c(piece.data) != piece.crc32c:
            raise lost(f"the CRC32C of the piece at offset {self._offset} of array {self._array} does not match")
        data: Any = _decompressed(piece.data, size) if compressed else piece.data
        destination.write(self._offset, data)
        if self._hash:
            self._hash.update(data)
        self._offset += size
        self._received += size
        if self._report:
            self._report("download", self._received / self._total, self._received)

    def _add_summary(self, summary: result_pb2.Summary) -> None:
        if self._place is None:
            raise lost("a summary before the header")
        if self._received != self._total:
            raise lost(f"it ended after {self._received} of {self._total} bytes")
        if self._hash and self._hash.hexdigest() != summary.content_sha256:
            raise lost("its SHA-256 is not the announced one")
        self._summary = summary


def _element(element: int) -> str:
    if element not in _ELEMENTS:
        raise lost(f"an array of the unknown type {element}")
    return _ELEMENTS[element]


def _counted(kind: str, shapes: list[tuple[int, ...]], planar: bool, place: GridPlace) -> list[tuple[int, ...]]:
    """The shapes of the lists, and that of a target without components. In: the announced shapes, none of them empty.

    The server chooses the lengths of lists, within what the grid can hold. Errors: DataLoss.
    """
    if kind == "dense":
        return [place.shape]
    if kind == "sparse":
        bricks, voxels = shapes[0][0], shapes[2][-1 if planar else 0]
        most = math.prod((axis + 7) // 8 for axis in place.dims)
        if bricks > most:
            raise lost(f"{bricks} bricks in a grid of {most}")
        if not bricks <= voxels <= 512 * bricks:
            raise lost(f"{voxels} voxels in {bricks} bricks")
        counted: list[tuple[int, ...]] = [(bricks,), (bricks, 64), (voxels,)]
    else:
        voxels, fragments = shapes[0][0], shapes[2][0]
        if not voxels <= fragments <= _MAX_FRAGMENTS:
            raise lost(f"{fragments} fragments in {voxels} voxels")
        counted = [(voxels,), (voxels + 1,), (fragments,), (fragments,)]
    if voxels > place.voxels:
        raise lost(f"{voxels} voxels listed in a grid of {place.voxels}")
    return counted


def _decompressed(data: memoryview, size: int) -> bytes:
    try:
        import zstandard
    except ImportError as error:
        raise MissingPackage("compression='zstd' needs the package zstandard", package="zstandard") from error
    try:
        if zstandard.frame_content_size(data) != size:
            raise lost("a compressed piece that is not one zstd frame of the announced size")
        result = zstandard.ZstdDecompressor().decompress(data, max_output_size=size, allow_extra_data=False)
    except zstandard.ZstdError as error:
        raise lost("a compressed piece is broken") from error
    if len(result) != size:
        raise lost("a compressed piece is broken")
    return bytes(result)


def _check_ids(ids: Array, name: str, end: int) -> None:
    if len(ids) and (int(ids[-1]) >= end or bool((ids[1:] <= ids[:-1]).any())):
        raise lost(f"the array {name} does not ascend below {end}")


def check_lists(kind: str, place: GridPlace, lists: dict[str, Array], values: int) -> None:
    """The consistency of the lists of sparse and bucketed results."""
    if kind == "sparse":
        bricks = [(axis + 7) // 8 for axis in place.dims]
        _check_ids(lists["brick"], "brick", bricks[0] * bricks[1] * bricks[2])
        found = 0
        for at in range(0, len(lists["brick"]), _BRICKS_AT_ONCE):
            part = slice(at, at + _BRICKS_AT_ONCE)
            found += _checked_masks(place, bricks, lists["brick"][part].astype(numpy.int64), lists["mask"][part])
        if found != values:
            raise lost(f"the masks have {found} voxels, which is not the announced number of values, {values}")
    elif kind == "buckets":
        _check_ids(lists["voxel"], "voxel", place.voxels)
        offset, triangle = lists["offset"], lists["triangle"]
        if int(offset[0]) != 0 or int(offset[-1]) != len(triangle) or bool((offset[1:] <= offset[:-1]).any()):
            raise lost(f"its offsets do not ascend from 0 to {len(triangle)}")
        falls = numpy.flatnonzero(triangle[1:] <= triangle[:-1]) + 1
        if not bool(numpy.isin(falls, offset).all()):
            raise lost("its triangles do not ascend within a voxel")


def _checked_masks(place: GridPlace, bricks: list[int], ids: Array, masks: Array) -> int:
    """The number of voxels of some bricks. Errors: DataLoss if a mask is empty or has voxels outside of the grid."""
    at = (ids % bricks[0], ids // bricks[0] % bricks[1], ids // (bricks[0] * bricks[1]))
    left = [numpy.clip(place.dims[axis] - 8 * at[axis], 0, 8) for axis in range(3)]
    row = (1 << left[0]) - 1
    eight = numpy.arange(8)
    inside = (eight < left[2][:, None])[:, :, None] & (eight < left[1][:, None])[:, None, :]
    allowed = numpy.where(inside, row[:, None, None], 0).astype(numpy.uint8)
    rows = masks.reshape(-1, 8, 8)
    if bool((rows & ~allowed).any()):
        raise lost("a mask has voxels outside of the grid")
    if not bool(masks.any(axis=1).all()):
        raise lost("a mask is empty")
    return int(numpy.unpackbits(masks).sum(dtype=numpy.int64))
