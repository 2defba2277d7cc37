"""The A-buffer: all fragments of each voxel."""
from __future__ import annotations

import dataclasses
from typing import Any

import numpy
import numpy.typing

from .errors import MissingPackage
from .place import GridPlace

Array = numpy.typing.NDArray[Any]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Buckets:
    """Fragments by voxel, as compressed rows: those of voxel `voxel[i]` are [offset[i], offset[i + 1]).

    voxel: u64 (n), linear indices i + nx*(j + ny*k), ascending. offset: u64 (n + 1). triangle: u32 (m), ids over the
    flattened scene, ascending within a voxel. values: the output of each target's shader for each fragment, (m[, c]).
    """

    place: GridPlace
    voxel: Array
    offset: Array
    triangle: Array
    values: dict[str, Array]

    @property
    def ijk(self) -> Array:
        """i, j, k of the voxels, int32 (n, 3)."""
        return self.place.linear_to_ijk(self.voxel)

    @property
    def counts(self) -> Array:
        """Fragments of each voxel, int64 (n)."""
        return numpy.diff(self.offset.astype(numpy.int64))

    def fragments(self, i: int, j: int, k: int) -> dict[str, Array]:
        """The fragments of one voxel: "triangle" and each target's values, views; empty if it has none."""
        if not bool(self.place.inside((i, j, k))):
            raise IndexError(f"the voxel ({i}, {j}, {k}) is outside of the grid of {self.place.dims}")
        linear = i + self.place.dims[0] * (j + self.place.dims[1] * k)
        at = int(numpy.searchsorted(self.voxel, numpy.uint64(linear)))
        found = at < len(self.voxel) and int(self.voxel[at]) == linear
        part = slice(int(self.offset[at]), int(self.offset[at + 1])) if found else slice(0, 0)
        return {"triangle": self.triangle[part], **{name: values[part] for name, values in self.values.items()}}

    def to_scipy(self) -> Any:
        """A scipy.sparse.csr_matrix of shape (n, triangles): row i is the voxel voxel[i]; each fragment is a 1."""
        try:
            from scipy import sparse
        except ImportError as error:
            raise MissingPackage("to_scipy needs the package scipy", package="scipy") from error
        columns = int(self.triangle.max()) + 1 if len(self.triangle) else 0
        ones = numpy.ones(len(self.triangle), numpy.uint8)
        return sparse.csr_matrix(
            (ones, self.triangle.astype(numpy.int64), self.offset.astype(numpy.int64)),
            shape=(len(self.voxel), columns),
        )
