"""Meshes whose faces have any number of corners, as PLY files: the loader triangulates them.

Source: G. Turk, "The PLY Polygon File Format" (Stanford University, 1994).
"""
from __future__ import annotations

import dataclasses
from typing import Any

import numpy
import numpy.typing

from ..errors import InvalidMesh

Array = numpy.typing.NDArray[Any]

# The linear pieces of quadratic cells, by the numbers of their points: corners first, then the middles of the edges.
_PIECES: dict[str, list[list[int]]] = {
    "triangle": [[0, 1, 2]],
    "quad": [[0, 1, 2, 3]],
    "triangle6": [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]],
    "triangle7": [[0, 3, 6], [3, 1, 6], [1, 4, 6], [4, 2, 6], [2, 5, 6], [5, 0, 6]],
    "quad8": [[0, 4, 7], [4, 1, 5], [5, 2, 6], [6, 3, 7], [4, 5, 6, 7]],
    "quad9": [[0, 4, 8, 7], [4, 1, 5, 8], [8, 5, 2, 6], [7, 8, 6, 3]],
}
# Higher ones, and others, whose pieces are not known here: an error beside those that are read.
_SURFACES = ("triangle", "quad", "polygon")


@dataclasses.dataclass
class Faces:
    """Faces in order: the number of corners of each, and the corners of all."""

    counts: list[Array] = dataclasses.field(default_factory=list)
    corners: list[Array] = dataclasses.field(default_factory=list)

    def add(self, counts: Array, corners: Array) -> None:
        """Adds faces with so many corners each."""
        self.counts.append(numpy.asarray(counts, numpy.int64).ravel())
        self.corners.append(numpy.asarray(corners).ravel())

    def add_cells(self, kind: str, cells: Array) -> bool:
        """Adds cells (n, points) of a kind as meshio names it; False if they are no surfaces. Errors: InvalidMesh."""
        if not kind.startswith(_SURFACES):
            return False
        pieces = [list(range(cells.shape[1]))] if kind.startswith("polygon") else _PIECES.get(kind)
        if pieces is None:
            known = ", ".join(_PIECES)
            raise InvalidMesh(f"cells of the kind {kind} are not read, only {known}, polygon", field="faces")
        sizes = [len(piece) for piece in pieces]
        self.add(numpy.tile(sizes, len(cells)), cells[:, [point for piece in pieces for point in piece]])
        return True

    def add_strips(self, offsets: Array, corners: Array) -> None:
        """Adds the triangles of strips: strip s has corners offsets[s] to offsets[s + 1]."""
        counts = numpy.maximum(numpy.diff(offsets) - 2, 0)
        step = numpy.arange(counts.sum()) - numpy.repeat(numpy.cumsum(counts) - counts, counts)
        at = numpy.repeat(offsets[:-1], counts) + step
        odd = step % 2  # every second triangle swaps its last two corners
        triangles = numpy.stack([corners[at], corners[at + 1 + odd], corners[at + 2 - odd]], axis=1)
        self.add(numpy.full(len(triangles), 3), triangles)

    def all_counts(self) -> Array:
        """The numbers of corners, one array."""
        return numpy.concatenate(self.counts) if self.counts else numpy.zeros(0, numpy.int64)

    def all_corners(self) -> Array:
        """The corners, one array."""
        return numpy.concatenate(self.corners) if self.corners else numpy.zeros(0, numpy.int64)


def write_ply(vertices: Array, faces: Faces, normals: Array | None, colors: Array | None) -> bytes:
    """A binary PLY. vertices: (n, 3) floats. normals: (n, 3) floats or None. colors: (n, 3) or (n, 4) uint8, sRGB, or
    None. Errors: InvalidMesh naming the first wrong face.
    """
    counts, corners = faces.all_counts(), faces.all_corners()
    wrong = (corners < 0) | (corners >= len(vertices))
    if bool(wrong.any()):
        face = int(numpy.searchsorted(numpy.cumsum(counts), int(wrong.argmax()), side="right"))
        raise InvalidMesh(
            f"faces: face {face} has the corner {int(corners[wrong.argmax()])}, and there are {len(vertices)} vertices",
            field="faces",
        )
    columns: list[tuple[str, str]] = [(axis, "<f8") for axis in "xyz"]
    if normals is not None:
        columns += [(f"n{axis}", "<f4") for axis in "xyz"]
    if colors is not None:
        columns += [(name, "u1") for name in ("red", "green", "blue", "alpha")[: colors.shape[1]]]
    table = numpy.zeros(len(vertices), numpy.dtype(columns))
    for array, first in ((vertices, 0), (normals, 3), (colors, 3 if normals is None else 6)):
        for axis in range(0 if array is None else array.shape[1]):
            table[columns[first + axis][0]] = array[:, axis]  # type: ignore[index]
    names = {"<f8": "double", "<f4": "float", "u1": "uchar"}
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    head += [f"property {names[kind]} {name}" for name, kind in columns]
    head += [f"element face {len(counts)}", "property list uint uint vertex_indices", "end_header", ""]
    # Each face is its count and its corners.
    begin = numpy.cumsum(counts) - counts + numpy.arange(len(counts))
    words = numpy.empty(len(counts) + len(corners), "<u4")
    words[begin] = counts
    is_corner = numpy.ones(len(words), bool)
    is_corner[begin] = False
    words[is_corner] = corners
    return "\n".join(head).encode() + table.tobytes() + words.tobytes()
