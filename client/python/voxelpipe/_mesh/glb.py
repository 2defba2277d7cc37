"""Writes a triangle mesh as GLB. Source: glTF 2.0 specification, sections 3.7.2 (meshes) and 4.4 (GLB)."""
from __future__ import annotations

import dataclasses
import json
import struct
from typing import Any

import numpy
import numpy.typing

from ..errors import InvalidMesh
from .colors import linear_colors

Array = numpy.typing.NDArray[Any]

_FLOAT, _DOUBLE, _UINT32 = 5126, 5130, 5125
_MAX_GLB_BYTES = 0xFFFFFFFF


@dataclasses.dataclass(frozen=True)
class Mesh:
    """A triangle mesh in arrays, anything that numpy takes, torch tensors included.

    vertices: (n, 3), world units; float64 is kept. faces: (m, 3) indices of vertices, or (m, 4) for quads, which are
    split along 0-2 (concave ones: where that lies inside). normals: (n, 3) of unit length, or None. colors: (n, 3) or
    (n, 4), integers that are sRGB codes from 0 to 255, or floats from 0 to 1, linear, or None; the shader `color` gives
    them, and `base_color` too.
    """

    vertices: Any
    faces: Any
    normals: Any = None
    colors: Any = None


def as_numpy(array: Any) -> Array:
    """A numpy array of an array of any library. torch tensors on a device are copied to the host."""
    if hasattr(array, "detach"):
        array = array.detach().cpu().numpy()
    return numpy.asarray(array)


def _checked(array: Any, name: str, columns: tuple[int, ...]) -> Array:
    result = as_numpy(array)
    if result.ndim == 2 and result.shape[1] in columns:
        return result
    if result.size == 0:
        return result.reshape(0, columns[0])
    raise InvalidMesh(
        f"{name}: the shape is {result.shape}, expected (n, {' or '.join(map(str, columns))})", field=name
    )


def checked_positions(vertices: Any) -> Array:
    """(n, 3), float32 if that holds all values, otherwise float64. Errors: InvalidMesh naming the first wrong row."""
    array = _checked(vertices, "vertices", (3,))
    floats = _floats(array, "vertices")
    if array.dtype == numpy.float32 or bool((floats == array).all()):
        return floats
    return numpy.ascontiguousarray(array, "<f8")


def _floats(array: Array, name: str) -> Array:
    if array.dtype.kind not in "fiu":
        raise InvalidMesh(f"{name}: {array.dtype} are no numbers", field=name)
    with numpy.errstate(over="ignore"):
        floats = numpy.ascontiguousarray(array, "<f4")
    bad = ~numpy.isfinite(floats).all(axis=1)
    if bool(bad.any()):
        raise InvalidMesh(f"{name}[{int(bad.argmax())}] is not finite as float32", field=name)
    return floats


def _triangles(faces: Array, vertices: Array) -> Array:
    if faces.size and faces.dtype.kind not in "iu":
        raise InvalidMesh(f"faces: {faces.dtype} are no indices", field="faces")
    if faces.size:
        wrong = ((faces < 0) | (faces >= len(vertices))).any(axis=1)
        if bool(wrong.any()):
            at = int(wrong.argmax())
            kind = "triangle" if faces.shape[1] == 3 else "quad"
            raise InvalidMesh(
                f"faces: {kind} {at} is {faces[at].tolist()}, and there are {len(vertices)} vertices", field="faces"
            )
    if faces.shape[1] == 4:
        faces = _split_quads(faces, vertices)
    return numpy.ascontiguousarray(faces, "<u4")


def _split_quads(faces: Array, vertices: Array) -> Array:
    """Two triangles a quad: split along 0-2, or along 1-3 where one half would be turned against the other."""
    corners = vertices[faces].astype(numpy.float64)
    first, diagonal, last = (corners[:, i] - corners[:, 0] for i in (1, 2, 3))
    turns = (numpy.cross(first, diagonal) * numpy.cross(diagonal, last)).sum(axis=1)
    longest = numpy.maximum.reduce([(edge * edge).sum(axis=1) for edge in (first, diagonal, last)])
    concave = turns < -1e-6 * longest * longest
    return numpy.where(
        concave[:, None], faces[:, [0, 1, 3, 1, 2, 3]], faces[:, [0, 1, 2, 0, 2, 3]]
    ).reshape(-1, 3)


def write_glb(mesh: Mesh) -> bytes:
    """The bytes of a GLB with this mesh. Errors: InvalidMesh naming the array and its first wrong row."""
    positions = checked_positions(mesh.vertices)
    triangles = _triangles(_checked(mesh.faces, "faces", (3, 4)), positions)
    in_double = positions.dtype.itemsize == 8
    parts: list[bytes] = []
    views: list[dict[str, object]] = []
    accessors: list[dict[str, object]] = []

    def add(array: Array, component_type: int, kind: str, **extra: object) -> int:
        data = array.tobytes()
        start = sum(map(len, parts))
        views.append({"buffer": 0, "byteOffset": start, "byteLength": len(data)})
        parts.extend((data, b"\0" * (-len(data) % 4)))
        count = array.size if kind == "SCALAR" else len(array)
        accessors.append(
            {"bufferView": len(views) - 1, "componentType": component_type, "count": count, "type": kind, **extra}
        )
        return len(accessors) - 1

    meshes: list[dict[str, object]] = []
    if len(triangles):
        box = {"min": positions.min(axis=0).tolist(), "max": positions.max(axis=0).tolist()}
        attributes = {"POSITION": add(positions, _DOUBLE if in_double else _FLOAT, "VEC3", **box)}
        if mesh.normals is not None:
            normals = _floats(_checked(mesh.normals, "normals", (3,)), "normals")
            attributes["NORMAL"] = add(_same_count(normals, positions, "normals"), _FLOAT, "VEC3")
        if mesh.colors is not None:
            colors = _same_count(_checked(mesh.colors, "colors", (3, 4)), positions, "colors")
            attributes["COLOR_0"] = add(linear_colors(colors), _FLOAT, f"VEC{colors.shape[1]}")
        indices = add(triangles, _UINT32, "SCALAR")
        meshes.append({"primitives": [{"attributes": attributes, "indices": indices}]})
    document: dict[str, object] = {
        "asset": {"version": "2.0", "generator": "voxelpipe"},
        "scene": 0,
        "scenes": [{"nodes": [0]} if meshes else {}],
    }
    if meshes and in_double:
        document |= {"extensionsUsed": ["KHR_accessor_float64"], "extensionsRequired": ["KHR_accessor_float64"]}
    if meshes:
        document |= {"nodes": [{"mesh": 0}], "meshes": meshes, "accessors": accessors, "bufferViews": views}
        document["buffers"] = [{"byteLength": sum(map(len, parts))}]
    return glb_of(document, parts)


def _same_count(array: Array, positions: Array, name: str) -> Array:
    if len(array) != len(positions):
        raise InvalidMesh(f"{name}: {len(array)} of them for {len(positions)} vertices", field=name)
    return array


def glb_of(document: dict[str, object], parts: list[bytes]) -> bytes:
    """A GLB of its JSON and the parts of its BIN chunk, which is left out if there are none. Errors: InvalidMesh."""
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    binary = sum(map(len, parts))
    padding = -binary % 4
    total = 12 + 8 + len(text) + (8 + binary + padding if parts else 0)
    if total > _MAX_GLB_BYTES:
        raise InvalidMesh(f"the mesh has {total} bytes, and a GLB at most {_MAX_GLB_BYTES}", field="vertices")
    chunks = [struct.pack("<4sII", b"glTF", 2, total), struct.pack("<I4s", len(text), b"JSON"), text]
    if parts:
        chunks += [struct.pack("<I4s", binary + padding, b"BIN\0"), *parts, b"\0" * padding]
    return b"".join(chunks)
