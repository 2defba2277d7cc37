"""GLB files of several solids, each a node with a name and a material."""
from __future__ import annotations

import dataclasses
import json
import struct
from typing import Any, Sequence

import numpy

from .. import shapes
from ..shapes import Array, Triangles


@dataclasses.dataclass(frozen=True)
class Body:
    """A closed surface. material: its name; color: its linear RGBA."""

    name: str
    material: str
    surface: Triangles
    color: tuple[float, float, float, float] = (1, 1, 1, 1)

    @property
    def corners(self) -> Array:
        """Of the triangles: float32 (m, 3, 3), as in the file."""
        vertices, faces = self.surface
        return numpy.asarray(vertices, numpy.float32)[_triangles(faces)]

    @property
    def volume(self) -> float:
        """Enclosed by the triangles."""
        a, b, c = numpy.moveaxis(self.corners.astype(numpy.float64), 1, 0)
        return float(numpy.einsum("ij,ij", a, numpy.cross(b, c)) / 6)

    @property
    def area(self) -> float:
        """Of the triangles."""
        a, b, c = numpy.moveaxis(self.corners.astype(numpy.float64), 1, 0)
        return float(numpy.linalg.norm(numpy.cross(b - a, c - a), axis=1).sum() / 2)


def _triangles(faces: Array) -> Array:
    """Triangles of triangles or of quads."""
    return faces if faces.shape[1] == 3 else numpy.concatenate([faces[:, [0, 1, 2]], faces[:, [0, 2, 3]]])


def box(low: Sequence[float], high: Sequence[float]) -> Triangles:
    """An axis-aligned box."""
    vertices, quads = shapes.cube()
    return numpy.asarray(low) + vertices * (numpy.asarray(high) - numpy.asarray(low)), quads


def ball(center: Sequence[float], radius: float) -> Triangles:
    """A ball of 2,208 triangles."""
    vertices, faces = shapes.ball()
    return numpy.asarray(center) + radius * vertices, faces


def rod(begin: Sequence[float], end: Sequence[float], radius: float, sides: int = 48) -> Triangles:
    """A cylinder between two points."""
    axis = numpy.subtract(end, begin)
    u = numpy.cross(axis, [0.3, 0.5, 0.8])
    u /= numpy.linalg.norm(u)
    v = numpy.cross(axis / numpy.linalg.norm(axis), u)
    phi = 2 * numpy.pi * numpy.arange(sides)[:, None] / sides
    ring = radius * (numpy.cos(phi) * u + numpy.sin(phi) * v)
    vertices = numpy.concatenate([begin + ring, end + ring, [begin], [end]])
    i = numpy.arange(sides)
    after = (i + 1) % sides
    faces = [
        numpy.stack([i, after, after + sides], 1),
        numpy.stack([i, after + sides, i + sides], 1),
        numpy.stack([after, i, numpy.full(sides, 2 * sides)], 1),
        numpy.stack([i + sides, after + sides, numpy.full(sides, 2 * sides + 1)], 1),
    ]
    return vertices, numpy.concatenate(faces)


def write_scene(bodies: Sequence[Body]) -> bytes:
    """A GLB with a node and a mesh for each body, and a material for each of their names."""
    materials = {body.material: body.color for body in bodies}
    document: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": list(range(len(bodies)))}],
        "nodes": [{"name": body.name, "mesh": i} for i, body in enumerate(bodies)],
        "materials": [
            {"name": name, "pbrMetallicRoughness": {"baseColorFactor": color}} for name, color in materials.items()
        ],
        "meshes": [],
        "accessors": [],
        "bufferViews": [],
    }
    data = b""
    for i, body in enumerate(bodies):
        points = body.corners.reshape(-1, 3).astype("<f4")
        document["bufferViews"].append({"buffer": 0, "byteOffset": len(data), "byteLength": points.nbytes})
        bounds = {"min": points.min(axis=0).tolist(), "max": points.max(axis=0).tolist()}
        document["accessors"].append(
            {"bufferView": i, "componentType": 5126, "count": len(points), "type": "VEC3", **bounds}
        )
        material = list(materials).index(body.material)
        document["meshes"].append({"primitives": [{"attributes": {"POSITION": i}, "material": material}]})
        data += points.tobytes()
    document["buffers"] = [{"byteLength": len(data)}]
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(data))
    return head + struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
