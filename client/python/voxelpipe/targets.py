"""Render targets and shaders of a request, and their text forms."""
from __future__ import annotations

import dataclasses
from typing import Any, Mapping, Sequence, Union, get_args

import numpy
import numpy.typing

from . import texts
from ._proto.voxelpipe.v1 import request_pb2
from .errors import InvalidRequest
from .names import Blend, Encoding, Format

ParameterValue = Union[float, int, str, Sequence[float], Sequence[Sequence[float]], "numpy.typing.NDArray[Any]"]

_FORMATS = get_args(Format)
_BLENDS = get_args(Blend)
DTYPES: dict[str, numpy.dtype[Any]] = {
    "bit": numpy.dtype(numpy.bool_),
    "u8": numpy.dtype("<u1"),
    "u16": numpy.dtype("<u2"),
    "u32": numpy.dtype("<u4"),
    "f16": numpy.dtype("<f2"),
    "f32": numpy.dtype("<f4"),
}


@dataclasses.dataclass(frozen=True)
class Shader:
    """A shader by name, with parameters: a number, numbers (a 4x4 matrix row by row), or a text each.

    `Shader("constant", value=...)` is written `Shader("constant", {"value": (0.5, 0.2, 1)})`; as text
    "constant:value=0.5/0.2/1". Client.shaders() lists all with their parameters.
    """

    name: str
    parameters: Mapping[str, ParameterValue] = dataclasses.field(default_factory=dict)

    @staticmethod
    def parse(text: str) -> "Shader":
        """In: "NAME" or "NAME:key=value,key=a/b/c". A value that is no numbers is a text, and so is that of the key
        `name`, which may stand in brackets: "attribute(_HEAT)". Errors: InvalidRequest.
        """
        try:
            parsed = texts.parse_shader(text)
        except texts.WrongText as error:
            raise InvalidRequest(f"shader: {error}", field="shader") from None
        return _shader_of(parsed.name, parsed.parameters)

    def to_message(self) -> request_pb2.ShaderCall:
        """The message of the service."""
        call = request_pb2.ShaderCall(name=self.name)
        for name, value in self.parameters.items():
            if isinstance(value, str):
                call.parameters.add(name=name, text=value)
            else:
                numbers = numpy.asarray(value, numpy.float64).ravel().tolist()
                call.parameters.add(name=name, numbers=request_pb2.Numbers(values=numbers))
        return call


@dataclasses.dataclass(frozen=True)
class Target:
    """A render target: one array of the result.

    name: under which the result has it; empty: "target0", "target1", ... by its place.
    components: 1 to 4; None: those of the shader (1 for bits and for the blend "count").
    blend: None: "or" for bits, else "replace". shader: None: the request's `shader`, or occupancy.
    clear: what voxels without fragment and fill hold. fill: what filled voxels without a fragment hold, one number or
    one a component; None: what the shader gives there without a triangle, else `clear`.
    scale: of floats into integers; None: 255 or 65535 for colours, else 1. quantum: of add and average on floats.
    encoding: "srgb" stores linear colours in u8 as sRGB; "snorm" normals and tangents, -1 to 1, as all of u8 or u16.
    Of both, clear and fill are codes.
    """

    format: Format = "bit"
    components: int | None = None
    blend: Blend | None = None
    shader: Shader | None = None
    name: str = ""
    clear: float = 0.0
    fill: float | Sequence[float] | None = None
    scale: float | None = None
    quantum: float | None = None
    encoding: Encoding = "linear"

    @staticmethod
    def parse(text: str, name: str = "", default_shader: Shader | None = None) -> "Target":
        """In: "[SHADER][:FORMAT[xC]][:BLEND][:key=value,...]", at least one part, as in "base_color:srgb8",
        "normal:f32", "attribute(_HEAT):f32x1:average" or "u8:max:clear=255"; the command line reads the same.

        FORMAT: also srgb8, which is u8 with the encoding srgb; without one f32, of occupancy bit. Keys: clear, fill,
        scale, quantum, encoding, shader in place of SHADER, or a parameter of the shader; without SHADER it goes on top
        of default_shader, that of the request. Errors: InvalidRequest.
        """
        try:
            parsed = texts.parse_target(text)
        except texts.WrongText as error:
            raise InvalidRequest(f"targets: {error}", field="targets") from None
        shader = None if parsed.shader is None else _shader_of(parsed.shader.name, parsed.shader.parameters)
        used = shader or default_shader or Shader("occupancy")
        if parsed.extra:
            shader = Shader(used.name, {**used.parameters, **_shader_of(used.name, parsed.extra).parameters})
        return Target(
            format=parsed.format or ("bit" if used.name == "occupancy" else "f32"),  # type: ignore[arg-type]
            components=parsed.components,
            blend=parsed.blend,  # type: ignore[arg-type]
            shader=shader,
            name=name,
            clear=0.0 if parsed.clear is None else parsed.clear,
            fill=None if parsed.fill is None else _one_or_several(parsed.fill),
            scale=parsed.scale,
            quantum=parsed.quantum,
            encoding=parsed.encoding or "linear",  # type: ignore[arg-type]
        )

    def to_message(self, default_shader: Shader | None = None) -> request_pb2.RenderTarget:
        """The message of the service. In: the request's shader, for targets without one of their own."""
        if self.format not in _FORMATS:
            raise InvalidRequest(f"format: '{self.format}' is none of {', '.join(_FORMATS)}", field="targets")
        if self.blend is not None and self.blend not in _BLENDS:
            raise InvalidRequest(f"blend: '{self.blend}' is none of {', '.join(_BLENDS)}", field="targets")
        if self.encoding not in get_args(Encoding):
            known = ", ".join(get_args(Encoding))
            raise InvalidRequest(f"encoding: '{self.encoding}' is none of {known}", field="targets")
        voxel_format = request_pb2.VoxelFormat.Value(f"VOXEL_FORMAT_{self.format.upper()}")
        message = request_pb2.RenderTarget(format=voxel_format, clear=self.clear)
        if self.components is not None:
            message.components = self.components
        if self.blend is not None:
            message.blend = request_pb2.Blend.Value(f"BLEND_{self.blend.upper()}")
        shader = self.shader or default_shader
        if shader is not None:
            message.shader.CopyFrom(shader.to_message())
        if self.fill is not None:
            message.fill.extend(numpy.atleast_1d(numpy.asarray(self.fill, numpy.float64)).tolist())
        if self.scale is not None:
            message.scale = self.scale
        if self.quantum is not None:
            message.quantum = self.quantum
        if self.encoding != "linear":
            message.encoding = request_pb2.Encoding.Value(f"ENCODING_{self.encoding.upper()}")
        return message


def _one_or_several(numbers: list[float]) -> float | list[float]:
    return numbers[0] if len(numbers) == 1 else numbers


def _shader_of(name: str, parameters: texts.Parameters) -> Shader:
    values = {key: value if isinstance(value, str) else _one_or_several(value) for key, value in parameters.items()}
    return Shader(name, values)
