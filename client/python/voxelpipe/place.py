"""Where a grid lies in the world, and the maps between indices and positions."""
from __future__ import annotations

import dataclasses
from typing import Literal, Tuple

import numpy
import numpy.typing

Floats = numpy.typing.NDArray[numpy.float64]
Integers = numpy.typing.NDArray[numpy.int64]
Vector = Tuple[float, float, float]


@dataclasses.dataclass(frozen=True, slots=True)
class GridPlace:
    """A grid: its size, and its place in the mesh's world (glTF: +Y up, right-handed, metres).

    Voxel (i, j, k) spans [i, i+1) x [j, j+1) x [k, k+1) in index space; index = (p - origin_corner) / voxel_size.
    Other software's "origin" is either the corner of the first voxel or its centre: here both have a name.

    dims: voxels along x, y, z; arrays have the shape (nz, ny, nx). origin_corner: world position of index (0, 0, 0),
    the lowest corner of voxel (0, 0, 0). voxel_size: world units along x, y, z.
    """

    dims: tuple[int, int, int]
    origin_corner: Vector
    voxel_size: Vector

    @property
    def shape(self) -> tuple[int, int, int]:
        """(nz, ny, nx): the shape of an array of the grid."""
        return self.dims[2], self.dims[1], self.dims[0]

    @property
    def voxels(self) -> int:
        """Number of voxels."""
        return self.dims[0] * self.dims[1] * self.dims[2]

    @property
    def origin_center(self) -> Vector:
        """World position of the centre of voxel (0, 0, 0)."""
        x, y, z = (corner + 0.5 * size for corner, size in zip(self.origin_corner, self.voxel_size))
        return x, y, z

    @property
    def index_to_world(self) -> Floats:
        """4x4: maps (i, j, k, 1) to the world position of that voxel's centre."""
        matrix = numpy.diag([*self.voxel_size, 1.0])
        matrix[:3, 3] = self.origin_center
        return matrix

    @property
    def bounds(self) -> Floats:
        """2x3: the lowest and the highest corner of the grid, world units."""
        low = numpy.asarray(self.origin_corner)
        return numpy.stack([low, low + numpy.asarray(self.dims) * numpy.asarray(self.voxel_size)])

    def world(self, ijk: "numpy.typing.ArrayLike", at: Literal["center", "corner"] = "center") -> Floats:
        """World positions (..., 3) of voxels i, j, k (..., 3): of their centres, or of their lowest corners."""
        index = numpy.asarray(ijk, numpy.float64)
        if index.shape[-1:] != (3,):
            raise ValueError(f"ijk has the shape {index.shape}; expected (..., 3)")
        origin = self.origin_center if at == "center" else self.origin_corner
        positions: Floats = numpy.asarray(origin) + index * self.voxel_size
        return positions

    def index(self, xyz: "numpy.typing.ArrayLike") -> Integers:
        """The voxels (..., 3), as i, j, k, that hold world positions (..., 3); they may lie outside of the grid."""
        positions = numpy.asarray(xyz, numpy.float64)
        if positions.shape[-1:] != (3,):
            raise ValueError(f"xyz has the shape {positions.shape}; expected (..., 3)")
        index: Integers = numpy.floor((positions - self.origin_corner) / self.voxel_size).astype(numpy.int64)
        return index

    def inside(self, ijk: "numpy.typing.ArrayLike") -> numpy.typing.NDArray[numpy.bool_]:
        """Which of the voxels (..., 3) the grid has."""
        index = numpy.asarray(ijk)
        inside: numpy.typing.NDArray[numpy.bool_] = ((index >= 0) & (index < self.dims)).all(axis=-1)
        return inside

    def linear_to_ijk(self, linear: "numpy.typing.ArrayLike") -> numpy.typing.NDArray[numpy.int32]:
        """i, j, k (n, 3) of voxels given by n = i + nx*(j + ny*k)."""
        k, j, i = numpy.unravel_index(numpy.asarray(linear, numpy.int64), self.shape)
        ijk: numpy.typing.NDArray[numpy.int32] = numpy.stack([i, j, k], axis=-1).astype(numpy.int32)
        return ijk
