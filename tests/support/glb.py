"""A minimal GLB writer: one mesh, one triangle list, positions only."""

import json
import struct

import numpy


def write_glb(path, positions, triangles):
    """Writes positions (n,3) in metres and triangles (m,3) of vertex indices as one GLB file."""
    positions = numpy.ascontiguousarray(positions, dtype="<f4")
    triangles = numpy.ascontiguousarray(triangles, dtype="<u4")
    position_bytes, index_bytes = positions.tobytes(), triangles.tobytes()
    document = {
        "asset": {"version": "2.0", "generator": "voxelpipe tests"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"byteLength": len(position_bytes) + len(index_bytes)}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": len(position_bytes), "target": 34962},
            {"buffer": 0, "byteOffset": len(position_bytes), "byteLength": len(index_bytes), "target": 34963},
        ],
        "accessors": [
            {
                "bufferView": 0,
                "componentType": 5126,
                "count": len(positions),
                "type": "VEC3",
                "min": positions.min(axis=0).tolist(),
                "max": positions.max(axis=0).tolist(),
            },
            {"bufferView": 1, "componentType": 5125, "count": int(triangles.size), "type": "SCALAR"},
        ],
    }
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    binary = position_bytes + index_bytes  # both are multiples of four bytes
    with open(path, "wb") as file:
        file.write(struct.pack("<4sII", b"glTF", 2, 12 + 8 + len(text) + 8 + len(binary)))
        file.write(struct.pack("<I4s", len(text), b"JSON") + text)
        file.write(struct.pack("<I4s", len(binary), b"BIN\0") + binary)
