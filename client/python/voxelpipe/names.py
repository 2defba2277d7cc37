"""The names that requests use, as types."""
from __future__ import annotations

from typing import Literal, Sequence, Union

Coverage = Literal["conservative", "thin", "center", "none"]
Fill = Literal["none", "parity", "nonzero", "flood"]
Fit = Literal["tight", "cube"]
PartScope = Literal["whole", "file", "node", "mesh", "material"]
ResultKind = Literal["dense", "sparse", "buckets"]
Backend = Literal["auto", "cpu", "cuda"]
Layout = Literal["interleaved", "planar"]
Priority = Literal["high", "normal", "low"]
Compression = Literal["none", "zstd"]
Format = Literal["bit", "u8", "u16", "u32", "f16", "f32"]
Blend = Literal["or", "and", "replace", "first", "min", "max", "add", "average", "count"]
Encoding = Literal["linear", "srgb", "snorm"]
MeshFormat = Literal["auto", "glb", "gltf", "draco", "stl", "ply", "off", "obj", "3mf"]
LengthUnit = Literal["mm", "cm", "m", "in"]

# One number for all axes, or x, y, z.
PerAxis = Union[float, Sequence[float]]
