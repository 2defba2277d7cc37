"""Reads the responses of one call into a VoxelGrid: checks every piece, and puts its bytes where they belong."""
from __future__ import annotations

import hashlib
import math
from typing import Any, Callable, Sequence

import numpy
import numpy.typing

from .._proto.voxelpipe.v1 import types_pb2 as types
from .._proto.voxelpipe.v1 import voxelization_service_pb2 as service
from ..device import DeviceArray, DeviceGrid
from ..errors import DataLoss, MissingPackage, TooLarge
from ..grid import VoxelGrid
from ..place import GridPlace
from ..report import Summary, read_place, read_warnings
from ..request import Request
from ..targets import DTYPES
from .crc32c import crc32c
from .wire import Piece, read_piece

Report = Callable[[str, float, int], None]

_MAX_RAW_BYTES = 64 << 20  # of one compressed piece
_MAX_AXIS = 1 << 40
_BRICKS_AT_ONCE = 1 << 14
_KINDS = {types.RESULT_KIND_DENSE: "dense", types.RESULT_KIND_SPARSE: "sparse", types.RESULT_KIND_BUCKETS: "buckets"}
_LISTS = {"dense": (), "sparse": ("brick", "mask"), "buckets": ("voxel", "offset", "triangle")}
_LIST_TYPES = {"brick": "u64", "mask": "u8", "voxel": "u64", "offset": "u64", "triangle": "u32"}
_LIST_DTYPES: dict[str, numpy.dtype[Any]] = {
    "u64": numpy.dtype("<u8"),
    "u32": numpy.dtype("<u4"),
    "u8": numpy.dtype("u1"),
}
_DEVICE_DTYPES = {**DTYPES, "bit": numpy.dtype("u1")}  # bits stay eight a byte

Array = numpy.typing.NDArray[Any]


def _lost(why: str) -> DataLoss:
    return DataLoss(f"the server's result: {why}")


def _taken_over(element: str, shape: tuple[int, ...], unpack: bool, data: Array) -> Array:
    """A flat array of bytes as what it is, without a copy but of bits that become bools. Errors: DataLoss."""
    if data.nbytes != _wire_bytes(element, shape):
        raise _lost(f"an array of {data.nbytes} bytes, {element} of shape {shape}")
    if element == "bit":
        count = math.prod(shape)
        bits = numpy.unpackbits(data, count=count, bitorder="little") if unpack else data
        return bits.view(numpy.bool_).reshape(shape) if unpack else data
    return data.view(_LIST_DTYPES.get(element) or DTYPES[element]).reshape(shape)


class _Destination:
    """An array that is being filled. In: its shape in elements, and whether bits become bools."""

    def __init__(self, element: str, shape: tuple[int, ...], unpack: bool) -> None:
        count = 1
        for axis in shape:
            count *= axis
        self._bits = count if element == "bit" and unpack else None
        if element == "bit":
            self.wire_bytes = (count + 7) // 8
            self.array: Array = numpy.empty(shape, numpy.bool_) if unpack else numpy.empty(self.wire_bytes, numpy.uint8)
        else:
            dtype: numpy.dtype[Any] = _LIST_DTYPES.get(element) or DTYPES[element]
            self.wire_bytes = count * dtype.itemsize
            self.array = numpy.empty(shape, dtype)
        self._bytes: Array = self.array.reshape(-1).view(numpy.uint8)

    def write(self, offset: int, data: Any) -> None:
        """Puts bytes of the stream at a byte of it."""
        incoming = numpy.frombuffer(data, numpy.uint8)
        if self._bits is None:
            self._bytes[offset : offset + len(incoming)] = incoming
            return
        first = offset * 8
        count = min(len(incoming) * 8, self._bits - first)
        self._bytes[first : first + count] = numpy.unpackbits(incoming, count=count, bitorder="little")


class ResultReader:
    """The result of one call. In: the request, the largest result that is taken, and who hears of progress."""

    def __init__(self, request: Request, max_result_bytes: int, request_id: str, report: Report | None) -> None:
        self._request = request
        self._max_result_bytes = max_result_bytes
        self._request_id = request_id
        self._report = report
        self._place: GridPlace | None = None
        self._kind = ""
        self._header = b""
        self._names: list[str] = []
        self._arrays: list[_Destination] = []
        self._array = self._offset = self._received = self._total = 0
        self._values = 0  # of sparse results, as announced
        self._summary: service.Summary | None = None
        self._hash = hashlib.sha256() if request.content_hash else None

    def add_bytes(self, message: bytes) -> None:
        """A VoxelizeResponse, encoded. Errors: DataLoss, TooLarge."""
        piece = read_piece(message)
        if piece is not None:
            self._add_piece(piece)
            return
        try:
            response = service.VoxelizeResponse.FromString(message)
        except Exception as error:  # protobuf's DecodeError, which has no public base
            raise _lost("a message that cannot be read") from error
        self.add(response)

    def add(self, response: service.VoxelizeResponse) -> None:
        """A VoxelizeResponse. Errors: DataLoss, TooLarge."""
        which = response.WhichOneof("message")
        if which == "progress" and self._report:
            self._report(response.progress.stage, response.progress.fraction, self._received)
        elif which == "header":
            self._add_header(response.header)
        elif which == "piece":
            self._add_message_piece(response.piece)
        elif which == "summary":
            self._add_summary(response.summary)
        elif which == "whole":
            self.add_whole(response.whole)

    def add_whole(self, whole: service.WholeResult) -> None:
        """A small result in one message. Errors: DataLoss, TooLarge."""
        self._add_header(whole.header)
        for piece in whole.pieces:
            self._add_message_piece(piece)
        self._add_summary(whole.summary)

    def taken_over(self, header: bytes, arrays: Sequence[Array], summary: bytes) -> VoxelGrid:
        """A result that was made in this process: ResultHeader, flat bytes of each array, Summary. Errors: DataLoss."""
        specs = self._read_header(service.ResultHeader.FromString(header))
        self._header = header
        if len(specs) != len(arrays):
            raise _lost(f"{len(arrays)} arrays, announced were {len(specs)}")
        unpack = not self._request.packed_bits
        taken = [_taken_over(element, shape, unpack, data) for (element, shape), data in zip(specs, arrays)]
        return self._grid(taken, service.Summary.FromString(summary))

    def taken_on_device(self, header: bytes, buffers: Sequence[Any], summary: bytes) -> DeviceGrid:
        """A dense result whose arrays are voxelpipe_core.DeviceBuffer objects. Errors: DataLoss."""
        specs = self._read_header(service.ResultHeader.FromString(header))
        if [buffer.size for buffer in buffers] != [_wire_bytes(element, shape) for element, shape in specs]:
            raise _lost("arrays of other sizes than announced")
        assert self._place is not None
        message = service.Summary.FromString(summary)
        arrays = {
            target.name: DeviceArray(buffer, shape if element != "bit" else (buffer.size,), _DEVICE_DTYPES[element])
            for target, buffer, (element, shape) in zip(self._request.targets, buffers, specs)
        }
        return DeviceGrid(
            place=self._place,
            targets=self._request.targets,
            arrays=arrays,
            warnings=read_warnings(message),
            summary=Summary.of(message, self._request_id),
        )

    def finish(self) -> VoxelGrid:
        """The result. Errors: DataLoss if anything of it is missing."""
        if self._summary is None or self._place is None:
            raise _lost("it ended before its summary")
        lists = {name: self._arrays[i].array for i, name in enumerate(_LISTS[self._kind])}
        _check_lists(self._kind, self._place, lists, self._values)
        return self._grid([destination.array for destination in self._arrays], self._summary)

    def _grid(self, arrays: list[Array], summary: service.Summary) -> VoxelGrid:
        assert self._place is not None
        lists = dict(zip(_LISTS[self._kind], arrays))
        return VoxelGrid(
            kind=self._kind,  # type: ignore[arg-type]
            place=self._place,
            layout="planar" if self._request.config.layout == types.LAYOUT_PLANAR else "interleaved",
            targets=self._request.targets,
            stored={target.name: arrays[len(lists) + i] for i, target in enumerate(self._request.targets)},
            lists=lists,
            packed_bits=self._request.packed_bits,
            warnings=read_warnings(summary),
            summary=Summary.of(summary, self._request_id),
            _config=self._request.encoded,
            _header=self._header,
        )

    def _add_header(self, header: service.ResultHeader) -> None:
        specs = self._read_header(header)
        self._header = header.SerializeToString()
        unpack = not self._request.packed_bits
        self._arrays = [_Destination(element, shape, unpack) for element, shape in specs]

    def _read_header(self, header: service.ResultHeader) -> list[tuple[str, tuple[int, ...]]]:
        """Element and shape of each array. Errors: DataLoss, TooLarge."""
        if self._place is not None:
            raise _lost("a second header")
        place = read_place(header.grid)
        if not all(0 < axis <= _MAX_AXIS for axis in place.dims):
            raise _lost(f"its dims are {place.dims}")
        self._check_grid(place)
        wanted = self._request.config.result or types.RESULT_KIND_DENSE
        if header.kind != wanted:
            raise _lost(f"a result of kind {header.kind}, requested was {wanted}")
        self._kind = _KINDS[wanted]
        specs = self._expected(header, place)
        self._total = sum(_wire_bytes(element, shape) for element, shape in specs)
        if self._total > self._max_result_bytes:
            raise TooLarge(
                f"the result has {self._total} bytes, this client takes {self._max_result_bytes} (max_result_bytes)",
                need_bytes=self._total,
                limit_bytes=self._max_result_bytes,
            )
        self._place = place
        return specs

    def _expected(self, header: service.ResultHeader, place: GridPlace) -> list[tuple[str, tuple[int, ...]]]:
        """Element and shape of each array, checked against the request."""
        names = [*_LISTS[self._kind], *(f"target{i}" for i in range(len(self._request.targets)))]
        if [array.name for array in header.arrays] != names:
            raise _lost(
                f"its arrays are {', '.join(array.name for array in header.arrays)}; expected {', '.join(names)}"
            )
        shapes = [tuple(int(axis) for axis in array.shape) for array in header.arrays]
        if any(axis > 1 << 48 for shape in shapes for axis in shape):
            raise _lost("an array is larger than any memory")
        elements = [_element(array.element_type) for array in header.arrays]
        lists = _LISTS[self._kind]
        for i, name in enumerate(lists):
            expected = {"mask": (shapes[0][0], 64), "offset": (shapes[0][0] + 1,)}.get(name, shapes[i][:1])
            if elements[i] != _LIST_TYPES[name] or shapes[i] != expected:
                raise _lost(f"its array {name} is {elements[i]} of shape {shapes[i]}")
        planar = self._request.config.layout == types.LAYOUT_PLANAR
        if self._kind == "dense":
            base: tuple[int, ...] = place.shape
        elif self._kind == "buckets":
            base = shapes[2]
        else:
            base = shapes[2][-1:] if planar else shapes[2][:1]
        self._values = base[0] if base else 0
        for i, target in enumerate(self._request.targets):
            element, shape = elements[len(lists) + i], shapes[len(lists) + i]
            extra = [shape[0] if planar else shape[-1]] if len(shape) == len(base) + 1 else []
            whole = (*extra, *base) if planar else (*base, *extra)
            components = extra[0] if extra else 1
            if element != target.format or shape != whole or not 1 <= components <= 4:
                raise _lost(f"its array target{i} is {element} of shape {shape}")
            if target.components not in (None, components):
                raise _lost(f"its array target{i} has {components} components, requested were {target.components}")
        return list(zip(elements, shapes))

    def _check_grid(self, place: GridPlace) -> None:
        grid = self._request.config.grid
        padding = 2 * grid.padding
        if grid.HasField("dims"):
            wanted = tuple(axis + padding for axis in (grid.dims.x, grid.dims.y, grid.dims.z))
            if place.dims != wanted:
                raise _lost(f"its dims are {place.dims}, requested were {wanted}")
        elif not grid.HasField("voxel_size") and max(place.dims) > grid.resolution + padding:
            raise _lost(
                f"its dims are {place.dims}, requested was resolution {grid.resolution}, padding {grid.padding}"
            )
        size = (grid.voxel_size.x, grid.voxel_size.y, grid.voxel_size.z)
        if grid.HasField("voxel_size") and place.voxel_size != size:
            raise _lost("its voxel size is not the requested one")

    def _add_message_piece(self, piece: service.ResultPiece) -> None:
        data = memoryview(piece.data)
        self._add_piece(Piece(piece.target, piece.offset, data, piece.crc32c, piece.raw_bytes))

    def _add_piece(self, piece: Piece) -> None:
        if self._place is None:
            raise _lost("a piece before the header")
        if not piece.data:
            raise _lost("a piece without bytes")
        while self._array < len(self._arrays) and self._offset == self._arrays[self._array].wire_bytes:
            self._array += 1
            self._offset = 0
        if self._array == len(self._arrays):
            raise _lost("more bytes than announced")
        if (piece.target, piece.offset) != (self._array, self._offset):
            raise _lost(
                f"a piece of array {piece.target} at offset {piece.offset}, expected was array {self._array} at "
                f"{self._offset}"
            )
        destination = self._arrays[self._array]
        raw_bytes = piece.raw_bytes or len(piece.data)
        if raw_bytes > destination.wire_bytes - self._offset or (piece.raw_bytes and raw_bytes > _MAX_RAW_BYTES):
            raise _lost(f"a piece of {raw_bytes} bytes at offset {self._offset} of array {self._array} is too long")
        if crc32c(piece.data) != piece.crc32c:
            raise _lost(f"the CRC32C of the piece at offset {self._offset} of array {self._array} does not match")
        data: Any = _decompressed(piece.data, raw_bytes) if piece.raw_bytes else piece.data
        destination.write(self._offset, data)
        if self._hash:
            self._hash.update(data)
        self._offset += raw_bytes
        self._received += raw_bytes
        if self._report:
            self._report("download", self._received / self._total, self._received)

    def _add_summary(self, summary: service.Summary) -> None:
        if self._place is None:
            raise _lost("a summary before the header")
        if self._received != self._total:
            raise _lost(f"it ended after {self._received} of {self._total} bytes")
        if self._hash and self._hash.hexdigest() != summary.content_sha256:
            raise _lost("its SHA-256 is not the announced one")
        self._summary = summary


def _element(element: int) -> str:
    if element not in types.ElementType.values():
        raise _lost(f"an array of the unknown type {element}")
    return str(types.ElementType.Name(element)).removeprefix("ELEMENT_TYPE_").lower()


def _wire_bytes(element: str, shape: tuple[int, ...]) -> int:
    count = 1
    for axis in shape:
        count *= axis
    if element == "bit":
        return (count + 7) // 8
    return count * {"u8": 1, "u16": 2, "f16": 2, "u32": 4, "f32": 4, "u64": 8}.get(element, 8)


def _decompressed(data: memoryview, raw_bytes: int) -> bytes:
    try:
        import zstandard
    except ImportError as error:
        raise MissingPackage("compression='zstd' needs the package zstandard", package="zstandard") from error
    try:
        if zstandard.frame_content_size(data) != raw_bytes:
            raise _lost("a compressed piece that is not one zstd frame of the announced size")
        result = zstandard.ZstdDecompressor().decompress(data, max_output_size=raw_bytes)
    except zstandard.ZstdError as error:
        raise _lost("a compressed piece is broken") from error
    if len(result) != raw_bytes:
        raise _lost("a compressed piece is broken")
    return bytes(result)


def _check_ids(ids: Array, name: str, end: int) -> None:
    if len(ids) and (int(ids[-1]) >= end or bool((ids[1:] <= ids[:-1]).any())):
        raise _lost(f"the array {name} does not ascend below {end}")


def _check_lists(kind: str, place: GridPlace, lists: dict[str, Array], values: int) -> None:
    """The consistency of the lists of sparse and bucketed results."""
    if kind == "sparse":
        bricks = [(axis + 7) // 8 for axis in place.dims]
        _check_ids(lists["brick"], "brick", bricks[0] * bricks[1] * bricks[2])
        found = 0
        for at in range(0, len(lists["brick"]), _BRICKS_AT_ONCE):
            part = slice(at, at + _BRICKS_AT_ONCE)
            found += _checked_masks(place, bricks, lists["brick"][part].astype(numpy.int64), lists["mask"][part])
        if found != values:
            raise _lost(f"the masks have {found} voxels, which is not the announced number of values, {values}")
    elif kind == "buckets":
        _check_ids(lists["voxel"], "voxel", place.voxels)
        offset, triangle = lists["offset"], lists["triangle"]
        if int(offset[0]) != 0 or int(offset[-1]) != len(triangle) or bool((offset[1:] <= offset[:-1]).any()):
            raise _lost(f"its offsets do not ascend from 0 to {len(triangle)}")
        falls = numpy.flatnonzero(triangle[1:] <= triangle[:-1]) + 1
        if not bool(numpy.isin(falls, offset).all()):
            raise _lost("its triangles do not ascend within a voxel")


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
        raise _lost("a mask has voxels outside of the grid")
    if not bool(masks.any(axis=1).all()):
        raise _lost("a mask is empty")
    return int(numpy.unpackbits(masks).sum(dtype=numpy.int64))
