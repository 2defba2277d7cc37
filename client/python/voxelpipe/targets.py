"""Render targets and shaders of a request, and their text forms."""
from __future__ import annotations

import dataclasses
import re
from typing import Any, Mapping, Sequence, Union, get_args

import numpy
import numpy.typing

from ._proto.voxelpipe.v1 import types_pb2 as types
from .errors import InvalidRequest
from .names import Blend, Encoding, Format

ParameterValue = Union[float, int, str, Sequence[float], Sequence[Sequence[float]], "numpy.typing.NDArray[Any]"]

_FORMATS = get_args(Format)
_BLENDS = get_args(Blend)
_FORMAT = re.compile(r"(bit|u8|u16|u32|f16|f32|srgb8)(?:x([1-4]))?")
_WRONG_FORMAT = re.compile(r"(bit|[ufi][0-9]+|srgb8?)(x[0-9]+)?")
_SHADER = re.compile(r"([A-Za-z_][A-Za-z0-9_]*)(?:\(([^()]*)\))?")
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
        """In: "NAME", "NAME(TEXT)" for `attribute`, or "NAME:key=value,key=a/b/c". Errors: InvalidRequest."""
        head, _, rest = text.partition(":")
        match = _SHADER.fullmatch(head.strip())
        if not match:
            raise InvalidRequest(f"shader: '{text}' is no shader; expected NAME[:key=value,...]", field="shader")
        parameters = _parsed_parameters(rest, "shader")
        if match[2] is not None:
            parameters["name"] = match[2]
        return Shader(match[1], parameters)

    def to_message(self) -> types.ShaderCall:
        """The message of the service."""
        call = types.ShaderCall(name=self.name)
        for name, value in self.parameters.items():
            if isinstance(value, str):
                call.parameters.append(types.ShaderParameter(name=name, text=value))
            else:
                numbers = numpy.asarray(value, numpy.float64).ravel().tolist()
                call.parameters.append(types.ShaderParameter(name=name, values=numbers))
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
    def parse(text: str, name: str = "") -> "Target":
        """A target from text, in one of two forms:

        "SHADER[:FORMAT[xC]][:BLEND][:key=value,...]", such as "base_color:srgb8", "normal:f32" or
        "attribute(_TEMPERATURE):f32x1:average"; and the command line's "FORMAT[xC]:BLEND[:key=value,...]", such as
        "f32x3:replace:shader=normal". "srgb8" is u8 with the encoding srgb. Keys: shader, clear, fill, scale, quantum,
        encoding, or a parameter of the shader. Errors: InvalidRequest.
        """
        return _parse_target(text, name)

    def to_message(self, default_shader: Shader | None = None) -> types.RenderTarget:
        """The message of the service. In: the request's shader, for targets without one of their own."""
        if self.format not in _FORMATS:
            raise InvalidRequest(f"format: '{self.format}' is none of {', '.join(_FORMATS)}", field="targets")
        if self.blend is not None and self.blend not in _BLENDS:
            raise InvalidRequest(f"blend: '{self.blend}' is none of {', '.join(_BLENDS)}", field="targets")
        if self.encoding not in get_args(Encoding):
            known = ", ".join(get_args(Encoding))
            raise InvalidRequest(f"encoding: '{self.encoding}' is none of {known}", field="targets")
        message = types.RenderTarget(format=types.VoxelFormat.Value(f"VOXEL_FORMAT_{self.format.upper()}"))
        if self.components is not None:
            message.components = self.components
        if self.blend is not None:
            message.blend = types.Blend.Value(f"BLEND_{self.blend.upper()}")
        shader = self.shader or default_shader
        if shader is not None:
            message.shader.CopyFrom(shader.to_message())
        message.clear = self.clear
        if self.fill is not None:
            message.fill_values.extend(numpy.atleast_1d(numpy.asarray(self.fill, numpy.float64)).tolist())
        if self.scale is not None:
            message.scale = self.scale
        if self.quantum is not None:
            message.quantum = self.quantum
        if self.encoding != "linear":
            message.encoding = types.Encoding.Value(f"ENCODING_{self.encoding.upper()}")
        return message


def _value(text: str) -> ParameterValue:
    try:
        numbers = [float(part) for part in text.split("/")]
    except ValueError:
        return text
    return numbers[0] if len(numbers) == 1 else numbers


def _parsed_parameters(text: str, field: str) -> dict[str, ParameterValue]:
    parameters: dict[str, ParameterValue] = {}
    for part in text.split(",") if text else []:
        key, equals, value = part.partition("=")
        if not equals or not key or not value:
            raise InvalidRequest(f"{field}: '{part}' is not key=value", field=field)
        if key in parameters:
            raise InvalidRequest(f"{field}: '{key}' is given twice", field=field)
        parameters[key] = _value(value)
    return parameters


def _number(value: ParameterValue, key: str) -> float:
    if isinstance(value, (int, float)):
        return float(value)
    raise InvalidRequest(f"targets: {key}={value!r} is no number", field="targets")


def _parse_target(text: str, name: str) -> Target:
    parts = [part.strip() for part in text.split(":")]
    if not all(parts):
        raise InvalidRequest(f"targets: '{text}' has an empty part", field="targets")
    settings = _parsed_parameters(parts.pop(), "targets") if "=" in parts[-1] else {}
    shader: Shader | None = None
    if parts and not _FORMAT.fullmatch(parts[0]):
        if _WRONG_FORMAT.fullmatch(parts[0]):
            raise InvalidRequest(f"targets: '{text}': '{parts[0]}' is no format", field="targets")
        shader = Shader.parse(parts.pop(0))
    fields: dict[str, object] = {"name": name}
    if parts:
        match = _FORMAT.fullmatch(parts[0])
        if match:
            fields["format"] = "u8" if match[1] == "srgb8" else match[1]
            if match[1] == "srgb8":
                fields["encoding"] = "srgb"
            if match[2]:
                fields["components"] = int(match[2])
            parts.pop(0)
    if "format" not in fields:
        fields["format"] = "bit" if shader is None or shader.name == "occupancy" else "f32"
    if parts:
        if parts[0] not in _BLENDS:
            raise InvalidRequest(
                f"targets: '{text}': '{parts[0]}' is neither a format ({', '.join(_FORMATS)}, srgb8) nor a blend "
                f"({', '.join(_BLENDS)})",
                field="targets",
            )
        fields["blend"] = parts.pop(0)
    if parts:
        raise InvalidRequest(f"targets: '{text}': '{parts[0]}' is left over", field="targets")
    if "shader" in settings:
        if shader is not None:
            raise InvalidRequest(f"targets: '{text}' names two shaders", field="targets")
        shader = Shader.parse(str(settings.pop("shader")))
    for key in ("clear", "scale", "quantum"):
        if key in settings:
            fields[key] = _number(settings.pop(key), key)
    if "fill" in settings:
        fields["fill"] = settings.pop("fill")
    if "encoding" in settings:
        fields["encoding"] = settings.pop("encoding")
    if settings:
        if shader is None:
            raise InvalidRequest(f"targets: '{text}': '{next(iter(settings))}' is no key of a target", field="targets")
        shader = Shader(shader.name, {**shader.parameters, **settings})
    return Target(shader=shader, **fields)  # type: ignore[arg-type]
