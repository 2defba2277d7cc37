"""Whether the content of a mesh file shows its format, by the rules of core/load/decode/mesh_format.h."""
from __future__ import annotations

import pathlib
import re
import struct

from .._proto.voxelpipe.v1 import types_pb2 as types

_SNIFFED_BYTES = 64 << 10
_SIGNATURES = (b"glTF", b"DRACO", b"PK\3\4")
_OFF = re.compile(rb"(ST)?C?N?4?n?OFF([0-9]\S*)?$")
# Statements of OBJ: those that begin a file without saying what it is, and the others that are read.
_SILENT = (b"g", b"o", b"s", b"mg", b"lod", b"bevel", b"c_interp", b"d_interp")
_READ = (b"v", b"vt", b"vn", b"f", b"fo", b"p", b"l", b"usemtl", b"mtllib")
_BY_EXTENSION = {
    ".glb": types.MESH_FORMAT_GLB,
    ".gltf": types.MESH_FORMAT_GLTF,
    ".drc": types.MESH_FORMAT_DRACO,
    ".stl": types.MESH_FORMAT_STL,
    ".ply": types.MESH_FORMAT_PLY,
    ".off": types.MESH_FORMAT_OFF,
    ".obj": types.MESH_FORMAT_OBJ,
    ".3mf": types.MESH_FORMAT_3MF,
}


def format_of(path: pathlib.Path, data: memoryview) -> int:
    """MESH_FORMAT_UNSPECIFIED where the content shows a format, which the loader then finds; else that of the file's
    extension, MESH_FORMAT_UNSPECIFIED if that is unknown too.
    """
    if _shows_format(bytes(data[:_SNIFFED_BYTES]), len(data)):
        return types.MESH_FORMAT_UNSPECIFIED
    return _BY_EXTENSION.get(path.suffix.lower(), types.MESH_FORMAT_UNSPECIFIED)


def _shows_format(beginning: bytes, file_bytes: int) -> bool:
    if beginning.startswith(_SIGNATURES):
        return True
    if len(beginning) >= 84 and 84 + 50 * struct.unpack_from("<I", beginning, 80)[0] == file_bytes:
        return True  # a binary STL
    text = beginning.removeprefix(b"\xef\xbb\xbf")
    first = text.split(maxsplit=1)[:1]
    if first and (first[0].startswith(b"{") or first[0] == b"ply" or first[0].lower() == b"solid"):
        return True
    lines = [line.partition(b"#")[0].split() for line in re.split(rb"\r\n|\n|\r", text)]
    words = [line[0] for line in lines if line]
    if words and _OFF.match(words[0]):
        return True
    statement = next((word for word in words if word not in _SILENT), b"")
    return statement in _READ
