"""Meshes made by code."""
from __future__ import annotations

from typing import Any, Tuple

import numpy
import numpy.typing

Array = numpy.typing.NDArray[Any]
Triangles = Tuple[Array, Array]

TETRAHEDRON: Triangles = (
    numpy.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], numpy.float64),
    numpy.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]),
)


def ball(rings: int = 24, sectors: int = 48) -> Triangles:
    """A ball of radius 1 about the origin: vertices (n, 3), faces (m, 3), outside counter-clockwise."""
    theta = numpy.linspace(0, numpy.pi, rings + 1)[:, None]
    phi = numpy.linspace(0, 2 * numpy.pi, sectors, endpoint=False)[None, :]
    x, y, z = numpy.sin(theta) * numpy.cos(phi), numpy.cos(theta) + 0 * phi, numpy.sin(theta) * numpy.sin(phi)
    vertices = numpy.stack([x, y, z], axis=-1)
    vertices[0], vertices[-1] = (0, 1, 0), (0, -1, 0)
    ring, sector = (index.ravel() for index in numpy.indices((rings, sectors)))
    after = (sector + 1) % sectors
    a, b = ring * sectors + sector, ring * sectors + after
    c, d = a + sectors, b + sectors
    faces = numpy.concatenate([numpy.stack([a, b, d], 1)[ring > 0], numpy.stack([a, d, c], 1)[ring < rings - 1]])
    return vertices.reshape(-1, 3), faces


def cube() -> Triangles:
    """The cube from 0 to 1."""
    vertices = numpy.array([[i, j, k] for k in (0, 1) for j in (0, 1) for i in (0, 1)], numpy.float64)
    quads = numpy.array([[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]])
    return vertices, quads


def heavy() -> Triangles:
    """Large triangles between random points: the work of seconds."""
    random = numpy.random.default_rng(1)
    return random.random((60_000, 3)), random.integers(0, 60_000, (200_000, 3))
