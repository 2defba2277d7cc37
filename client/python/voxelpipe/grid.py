"""The result of a request."""
from __future__ import annotations

import dataclasses
import hashlib
import os
from typing import Any, Iterator, Literal, NamedTuple

import numpy
import numpy.typing

from ._export import convert, picture, save
from .buckets import Array, Buckets
from .names import Layout, ResultKind
from .part_table import Parts
from .place import Floats, GridPlace, Integers, Vector
from .report import MeshWarning, Summary
from .targets import Target

_HASH_VOXELS = 1 << 26  # a multiple of 8


class Sparse(NamedTuple):
    """The occupied voxels. ijk: int32 (n, 3), in x, y, z. values: of each target by name, (n[, c])."""

    ijk: Array
    values: dict[str, Array]


@dataclasses.dataclass(frozen=True, slots=True, eq=False, repr=False)
class VoxelGrid:
    """Voxels: where they lie, and the values of each target.

    `grid.color` or `grid["color"]` is the array of the target "color" (targets without a name are "target0",
    "target1", ...). Arrays are C-contiguous, writable and owned by this object.

    dense: (nz, ny, nx), with c components (nz, ny, nx, c), planar (c, nz, ny, nx): index them by [k, j, i]. Bits are
    bool. sparse: values of the occupied voxels, (n), (n, c) or (c, n), in the order of `sparse().ijk`. buckets: values
    of the fragments, (m), (m, c) or (c, m); see `buckets`.

    parts: of a request with `parts`: label, name, triangles, voxels, ... of each part; None of other requests, and of a
    mesh without triangles.

    Two grids are equal if their place, kind, targets and parts and all of their bytes are. They can be pickled.
    """

    kind: ResultKind
    place: GridPlace
    layout: Layout
    targets: tuple[Target, ...]
    stored: dict[str, Array]  # of each target; bits of packed results as bytes
    lists: dict[str, Array]  # sparse: brick, mask; buckets: voxel, offset, triangle
    parts: Parts | None
    packed_bits: bool
    warnings: tuple[MeshWarning, ...]
    summary: Summary
    _request: bytes  # the VoxelizeRequest without its mesh and the ResultHeader, for writers of files
    _header: bytes

    # ---- arrays ----

    @property
    def array(self) -> Array:
        """The array of the first target."""
        return self[self.targets[0].name]

    def __getitem__(self, name: str) -> Array:
        """The array of a target. Bits of a packed result are unpacked into a new array.

        Errors: KeyError that lists the targets, as in every method that takes the name of a target.
        """
        if name not in self.stored:
            raise KeyError(self._no_target(name))
        stored = self.stored[name]
        if self.packed_bits and self._target(name).format == "bit":
            return self._unpacked(stored)
        return stored

    def __getattr__(self, name: str) -> Array:
        if name.startswith("_") or name in _FIELDS:
            raise AttributeError(name)
        if name not in self.stored:
            raise AttributeError(self._no_target(name))
        return self[name]

    def __dir__(self) -> Iterator[str]:
        return iter([*object.__dir__(self), *self.stored])

    @property
    def mask(self) -> Array:
        """Which voxels are occupied (have a fragment or are filled): bool (nz, ny, nx).

        Of a dense result, the target "mask", else its first bit target of occupancy; of others, made of their lists.
        Errors: ValueError if a dense result has no such target.
        """
        if self.kind == "dense":
            for target in self.targets:
                occupancy = target.shader is None or target.shader.name == "occupancy"
                if target.format == "bit" and (target.name == "mask" or occupancy):
                    return self[target.name]
            raise ValueError("this result does not say which voxels are occupied; add the target 'bit'")
        mask = numpy.zeros(self.place.shape, numpy.bool_)
        i, j, k = self.occupied().T
        mask[k, j, i] = True
        return mask

    def packed(self, name: str = "") -> Array:
        """The bits of a dense bit target, eight a byte: bit n is (byte[n // 8] >> (n % 8)) & 1, n = i + nx*(j + ny*k).

        In: the target; by default the first one of bits. Out: uint8 (ceil(voxels / 8)); of a packed result the array
        itself, else a new one. Errors: ValueError if it has no bits.
        """
        for target in self.targets:
            if target.format == "bit" and name in ("", target.name):
                stored = self.stored[target.name]
                return stored if self.packed_bits else numpy.packbits(stored.reshape(-1), bitorder="little")
        raise ValueError(f"'{name}' is no bit target of this result" if name else "this result has no bit target")

    def occupied(self) -> Array:
        """The occupied voxels: i, j, k as int32 (n, 3), in x, y, z."""
        if self.kind == "dense":
            return self.place.linear_to_ijk(numpy.flatnonzero(self.mask))
        if self.kind == "buckets":
            return self.place.linear_to_ijk(self.lists["voxel"])
        bits = numpy.unpackbits(self.lists["mask"], axis=1, bitorder="little")
        brick, bit = numpy.nonzero(bits)
        nx, ny, _ = ((axis + 7) // 8 for axis in self.place.dims)
        ids = self.lists["brick"].astype(numpy.int64)[brick]
        i = ids % nx * 8 + (bit & 7)
        j = ids // nx % ny * 8 + (bit >> 3 & 7)
        k = ids // (nx * ny) * 8 + (bit >> 6)
        ijk: Array = numpy.stack([i, j, k], axis=-1).astype(numpy.int32)
        return ijk

    def sparse(self) -> Sparse:
        """The occupied voxels and their values. Errors: ValueError for buckets, whose voxels have several values."""
        if self.kind == "buckets":
            raise ValueError("the voxels of buckets have several values each; see `buckets`")
        ijk = self.occupied()
        planar = self.layout == "planar"
        values = {}
        for target in self.targets:
            array = self[target.name]
            if planar and array.ndim == (4 if self.kind == "dense" else 2):
                array = numpy.moveaxis(array, 0, -1)
            values[target.name] = array[ijk[:, 2], ijk[:, 1], ijk[:, 0]] if self.kind == "dense" else array
        return Sparse(ijk, values)

    def dense(self, name: str = "") -> Array:
        """Every voxel of a target, (nz, ny, nx[, c]); a new array if sparse. Errors: ValueError for buckets."""
        name = name or self.targets[0].name
        if self.kind == "dense":
            array = self[name]
            return numpy.moveaxis(array, 0, -1) if self.layout == "planar" and array.ndim == 4 else array
        if name not in self.stored:
            raise KeyError(self._no_target(name))
        ijk, values = self.sparse()
        listed = values[name]
        clear = _stored(self._target(name).clear, listed.dtype)
        array = numpy.full((*self.place.shape, *listed.shape[1:]), clear, listed.dtype)
        array[ijk[:, 2], ijk[:, 1], ijk[:, 0]] = listed
        return array

    @property
    def buckets(self) -> Buckets:
        """All fragments of each voxel. Errors: ValueError unless the request's result was "buckets"."""
        if self.kind != "buckets":
            raise ValueError(f"this result is {self.kind}; ask for result='buckets'")
        planar = self.layout == "planar"
        values = {name: self[name].T if planar and self[name].ndim == 2 else self[name] for name in self.stored}
        return Buckets(self.place, self.lists["voxel"], self.lists["offset"], self.lists["triangle"], values)

    # ---- place ----

    @property
    def dims(self) -> tuple[int, int, int]:
        """Voxels along x, y, z."""
        return self.place.dims

    @property
    def voxel_size(self) -> Vector:
        """World units along x, y, z."""
        return self.place.voxel_size

    @property
    def origin_corner(self) -> Vector:
        """World position of the lowest corner of voxel (0, 0, 0)."""
        return self.place.origin_corner

    @property
    def origin_center(self) -> Vector:
        """World position of the centre of voxel (0, 0, 0)."""
        return self.place.origin_center

    @property
    def index_to_world(self) -> Floats:
        """4x4: maps (i, j, k, 1) to the world position of that voxel's centre."""
        return self.place.index_to_world

    @property
    def bounds(self) -> Floats:
        """2x3: the lowest and the highest corner of the grid, world units."""
        return self.place.bounds

    def world(self, ijk: "numpy.typing.ArrayLike", at: Literal["center", "corner"] = "center") -> Floats:
        """World positions (..., 3) of voxels i, j, k (..., 3): of their centres, or of their lowest corners."""
        return self.place.world(ijk, at)

    to_world = world

    def index(self, xyz: "numpy.typing.ArrayLike") -> Integers:
        """The voxels (..., 3), as i, j, k, that hold world positions (..., 3); they may lie outside of the grid."""
        return self.place.index(xyz)

    to_index = index

    # ---- bytes ----

    @property
    def nbytes(self) -> int:
        """Memory of all arrays, in bytes."""
        parts = 0 if self.parts is None else self.parts.nbytes
        return parts + sum(array.nbytes for array in (*self.lists.values(), *self.stored.values()))

    @property
    def sha256(self) -> str:
        """SHA-256 of the result's bytes in stream order, hexadecimal: the `hash` of the command line."""
        digest = hashlib.sha256()
        for array in self.lists.values():
            digest.update(array.reshape(-1).data)
        for target in self.targets:
            flat = self.stored[target.name].reshape(-1)
            if target.format != "bit" or self._is_packed(target.name):
                digest.update(flat.data)
                continue
            for at in range(0, len(flat), _HASH_VOXELS):
                digest.update(numpy.packbits(flat[at : at + _HASH_VOXELS], bitorder="little").data)
        for array in self._part_arrays():
            digest.update(array.data)
        return digest.hexdigest()

    def _streamed(self) -> list[Array]:
        """All arrays in stream order as flat bytes, without a copy but of bits, which become eight a byte."""
        arrays = [array.reshape(-1).view(numpy.uint8) for array in self.lists.values()]
        for target in self.targets:
            flat = self.stored[target.name].reshape(-1)
            plain = target.format != "bit" or self.packed_bits
            arrays.append(flat.view(numpy.uint8) if plain else numpy.packbits(flat, bitorder="little"))
        return arrays + [array.view(numpy.uint8) for array in self._part_arrays()]

    def _part_arrays(self) -> list[Array]:
        return [] if self.parts is None else list(self.parts._arrays.values())

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, VoxelGrid):
            return NotImplemented
        if (self.kind, self.place, self.layout) != (other.kind, other.place, other.layout):
            return False
        if [target.format for target in self.targets] != [target.format for target in other.targets]:
            return False
        if list(self.stored) != list(other.stored) or list(self.lists) != list(other.lists):
            return False
        if self.parts != other.parts:
            return False
        mixed = self.packed_bits != other.packed_bits
        return all(
            _same_bytes(self[name], other[name]) if mixed else _same_bytes(self.stored[name], other.stored[name])
            for name in self.stored
        ) and all(_same_bytes(self.lists[name], other.lists[name]) for name in self.lists)

    __hash__ = None  # type: ignore[assignment]

    def _no_target(self, name: object) -> str:
        return f"a VoxelGrid has no {name!r}; its targets are: {', '.join(self.stored)}"

    def _target(self, name: str) -> Target:
        return next(target for target in self.targets if target.name == name)

    def _is_packed(self, name: str) -> bool:
        return self.packed_bits and self._target(name).format == "bit"

    def _unpacked(self, stored: Array) -> Array:
        if self.kind == "dense":
            shape: tuple[int, ...] = self.place.shape
        elif self.kind == "sparse":
            shape = (int(numpy.unpackbits(self.lists["mask"]).sum()),)
        else:
            shape = self.lists["triangle"].shape
        count = int(numpy.prod(shape))
        return numpy.unpackbits(stored, count=count, bitorder="little").view(numpy.bool_).reshape(shape)

    # ---- other libraries ----

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        """The first target's array."""
        array = self.array if dtype is None else self.array.astype(dtype, copy=False)
        return array.copy() if copy else array

    def __dlpack__(
        self,
        *,
        stream: Any = None,
        max_version: tuple[int, int] | None = None,
        dl_device: tuple[Any, int] | None = None,
        copy: bool | None = None,
    ) -> Any:
        """The first target's array; bits as uint8, which every library takes. The capsule is numpy's: from numpy 2.1 on
        with a version, if the consumer takes one. Errors: BufferError for another device than this machine's memory.
        """
        if dl_device not in (None, self.__dlpack_device__()):
            raise BufferError(f"the result is in this machine's memory, not on the device {dl_device}")
        array: Any = convert.for_dlpack(self.array)
        array = array.copy() if copy else array
        try:
            return array.__dlpack__(stream=stream, max_version=max_version)
        except TypeError:  # numpy before 2.1 knows no versions
            return array.__dlpack__(stream=stream)

    def __dlpack_device__(self) -> tuple[int, int]:
        return 1, 0

    def to_torch(self, name: str = "", *, unsigned: Literal["widen", "bits"] = "widen") -> Any:
        """A torch.Tensor of a target (default: the first one) on the CPU; it shares the memory unless it is widened.

        torch has no u16 and u32 before 2.3. unsigned: "widen" makes int32 and int64 of them, of the same values; "bits"
        makes int16 and int32 of the same bits. Errors: MissingPackage.
        """
        return convert.to_torch(self[name] if name else self.array, unsigned)

    def to_xarray(self) -> Any:
        """An xarray.Dataset of the targets of a dense result: dims z, y, x[, component]; coordinates: centres."""
        return convert.to_xarray(self)

    def to_trimesh(self) -> Any:
        """A trimesh.voxel.VoxelGrid of the mask, in world coordinates. Errors: MissingPackage."""
        return convert.to_trimesh(self)

    def to_open3d(self, color: str = "") -> Any:
        """An open3d.geometry.PointCloud of the centres of the occupied voxels. color: a target of u8 or floats."""
        return convert.to_open3d(self, color)

    def to_vtk(self) -> Any:
        """A vtkImageData with the targets of a dense result as cell data."""
        return convert.to_vtk(self)

    def to_pyvista(self) -> Any:
        """A pyvista.ImageData with the targets of a dense result as cell data. Errors: MissingPackage."""
        return convert.to_pyvista(self)

    def to_napari(self, name: str = "") -> dict[str, Any]:
        """Keyword arguments for napari.Viewer.add_image: data, name, scale and translate (z, y, x)."""
        return convert.to_napari(self, name)

    def save(self, path: "str | os.PathLike[str]", *, compress: bool = False) -> None:
        """Writes a file; the extension decides its format. It appears under its name when it is complete.

        .npy and .raw (with .raw.json) hold one target of a dense result, .npz all by their names, .png the picture of
        notebooks. With the package voxelpipe-core it writes all formats of the command line (client/README.md), the
        same bytes; these name targets "target0", "target1", ... in their order.

        compress: of .npz, whose arrays are stored as they are by default: deflates them, quickly. numpy and
        load_result() read both; the command line's compare and --grid-like read stored ones alone.

        Warns (UserWarning) of what a format does not keep. Errors: ValueError for an extension that is none, and for a
        format that cannot hold this result; with strict=True in the request, for what would be a warning;
        MissingPackage without voxelpipe-core; TooLarge; OSError. Ctrl-C ends it. After an error there is no file.
        """
        save.save(self, path, compress)

    def show(self) -> None:
        """Shows the result: in a notebook size, place and picture; else as a page in the browser.

        The page is the viewer of .html files (see save()) if voxelpipe-core is installed and the result is not buckets,
        else size, place and picture. It stays in the folder of temporary files.
        """
        picture.show(self)

    def _repr_png_(self) -> bytes:
        """Views of the occupied voxels along z, y and x, for notebooks."""
        return picture.png(self)

    def _repr_html_(self) -> str:
        """Size, place and picture, for notebooks."""
        return picture.html(self)

    def __repr__(self) -> str:
        size = " x ".join(f"{axis:.6g}" for axis in self.voxel_size)
        names = ", ".join(f"{target.name} {target.format}" for target in self.targets)
        parts = "" if self.parts is None else f"; parts: {len(self.parts)}"
        nx, ny, nz = self.dims
        return (
            f"<VoxelGrid {self.kind}: {nx} x {ny} x {nz} voxels of {size}, {self.summary.occupied} occupied; "
            f"targets: {names}{parts}>"
        )


_FIELDS = frozenset(field.name for field in dataclasses.fields(VoxelGrid))


def _stored(clear: float, dtype: "numpy.typing.DTypeLike") -> Any:
    """A `clear` as a target of this type stores it: rounded to the nearest even integer, within the type's range."""
    kind: Any = numpy.dtype(dtype)
    if kind.kind == "b":
        return clear != 0
    if kind.kind == "f":
        return kind.type(clear)
    limits = numpy.iinfo(kind)
    return kind.type(round(min(max(clear, limits.min), limits.max))) if clear == clear else kind.type(0)


def _same_bytes(one: Array, other: Array) -> bool:
    if one.shape != other.shape or one.dtype != other.dtype:
        return False
    return bool(numpy.array_equal(one.reshape(-1).view(numpy.uint8), other.reshape(-1).view(numpy.uint8)))
