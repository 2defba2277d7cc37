"""Shaders and targets of a request as text, by the grammar of core/request_text, as all programs take them.

tests/unit/request_text/request_cases.json has texts with what they mean, for this file and for the core.
"""
from __future__ import annotations

import dataclasses
import re
from typing import Union

_SHADER = re.compile(r"([A-Za-z_][A-Za-z0-9_]*)(?:\(([^()]+)\))?")
_NUMBER = re.compile(
    r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:e[+-]?[0-9]+)?|[+-]?inf(?:inity)?", re.IGNORECASE | re.ASCII
)
_FORMAT = re.compile(r"(bit|u8|u16|u32|f16|f32|srgb8)(?:x([1-4]))?")
_LIKE_A_FORMAT = re.compile(r"(?:bit|srgb8?|[ufi][0-9]+)(?:x[0-9]*)?")
_BLENDS = ("or", "replace", "min", "max", "add", "first", "average", "count", "and")
_ENCODINGS = ("linear", "srgb", "snorm")
_KNOWN_FORMATS = "bit, u8, u16, u32, f16, f32 and srgb8"
_KNOWN_BLENDS = "or, replace, min, max, add, first, average, count and and"

Parameters = dict[str, Union[str, list[float]]]


class WrongText(ValueError):
    """What is wrong with a text."""


@dataclasses.dataclass
class ShaderText:
    """A shader: its name, and its parameters as numbers or as a text each."""

    name: str = ""
    parameters: Parameters = dataclasses.field(default_factory=dict)


@dataclasses.dataclass
class TargetText:
    """A target; None: not in the text. extra: parameters that the text gives besides a shader of its own."""

    shader: ShaderText | None = None
    format: str | None = None
    components: int | None = None
    blend: str | None = None
    encoding: str | None = None
    clear: float | None = None
    scale: float | None = None
    quantum: float | None = None
    fill: list[float] | None = None
    extra: Parameters = dataclasses.field(default_factory=dict)


def split_outside_brackets(text: str, separator: str) -> list[str]:
    """The parts of the text between separators outside of brackets."""
    parts, inside = [""], False
    for character in text:
        inside = character == "(" or (inside and character != ")")
        if character == separator and not inside:
            parts.append("")
        else:
            parts[-1] += character
    return parts


def parse_number(text: str) -> float:
    """A decimal number or inf. Errors: WrongText."""
    if not _NUMBER.fullmatch(text):
        raise WrongText(f"'{text}' is not a number")
    return float(text)


def parse_numbers(text: str, separator: str) -> list[float]:
    """The numbers between separators. Errors: WrongText."""
    return [parse_number(part) for part in split_outside_brackets(text, separator)]


def _settings(text: str) -> dict[str, str]:
    settings: dict[str, str] = {}
    for part in split_outside_brackets(text, ","):
        key, _, value = part.partition("=")
        if not key or not value:
            raise WrongText(f"'{part}' is not key=value")
        if key in settings:
            raise WrongText(f"'{key}' is given twice")
        settings[key] = value
    return settings


def _shader_name(text: str) -> ShaderText:
    match = _SHADER.fullmatch(text)
    if not match:
        raise WrongText(f"'{text}' is no shader: NAME or NAME(TEXT)")
    return ShaderText(match[1], {} if match[2] is None else {"name": match[2]})


def _set_parameter(key: str, value: str, parameters: Parameters) -> None:
    if key in parameters:
        raise WrongText(f"'{key}' is given twice")
    try:
        parameters[key] = value if key == "name" else parse_numbers(value, "/")
    except WrongText:
        parameters[key] = value


def parse_shader(text: str) -> ShaderText:
    """In: "NAME", "NAME(TEXT)" or "NAME:key=value,...". Errors: WrongText."""
    name = split_outside_brackets(text, ":")[0]
    shader = _shader_name(name)
    if name != text:
        for key, value in _settings(text[len(name) + 1 :]).items():
            _set_parameter(key, value, shader.parameters)
    return shader


def _read_format(text: str, target: TargetText) -> None:
    match = _FORMAT.fullmatch(text)
    if not match:
        raise WrongText(f"'{text}' is no format; known are {_KNOWN_FORMATS}, with x1 to x4 for components")
    if match[1] == "srgb8":
        target.encoding = "srgb"
    target.format = "u8" if match[1] == "srgb8" else match[1]
    target.components = int(match[2]) if match[2] else None


def _read_parts(parts: list[str], target: TargetText) -> None:
    parts = list(parts)
    if parts and not _LIKE_A_FORMAT.fullmatch(parts[0]):
        target.shader = _shader_name(parts.pop(0))
    if parts and _LIKE_A_FORMAT.fullmatch(parts[0]):
        _read_format(parts.pop(0), target)
    if parts:
        if parts[0] not in _BLENDS:
            formats = "" if target.format else f"{_KNOWN_FORMATS}, and "
            kind = "blend" if target.format else "format and no blend"
            raise WrongText(f"'{parts[0]}' is no {kind}; known are {formats}{_KNOWN_BLENDS}")
        target.blend = parts.pop(0)
    if parts:
        raise WrongText(f"'{parts[0]}' is left over: keys and values end a target")


def _read_setting(key: str, value: str, target: TargetText) -> None:
    try:
        if key == "clear":
            target.clear = parse_number(value)
        elif key == "scale":
            target.scale = parse_number(value)
        elif key == "quantum":
            target.quantum = parse_number(value)
        elif key == "fill":
            target.fill = parse_numbers(value, "/")
    except WrongText as error:
        raise WrongText(f"{key}: {error}") from None
    if key == "shader":
        if target.shader is not None:
            raise WrongText("the target names two shaders")
        target.shader = _shader_name(value)
    elif key == "encoding":
        if target.encoding is not None:
            raise WrongText("srgb8 has the encoding srgb: leave encoding out")
        if value not in _ENCODINGS:
            raise WrongText(f"encoding: '{value}' is not known; known are linear, srgb and snorm")
        target.encoding = value
    elif key not in ("clear", "scale", "quantum", "fill"):
        _set_parameter(key, value, target.extra)


def parse_target(text: str) -> TargetText:
    """In: "[SHADER][:FORMAT[xC]][:BLEND][:key=value,...]". Errors: WrongText, which begins with the text."""
    try:
        parts = split_outside_brackets(text, ":")
        if not all(parts):
            raise WrongText("it has an empty part")
        settings = _settings(parts.pop()) if len(split_outside_brackets(parts[-1], "=")) > 1 else {}
        target = TargetText()
        _read_parts(parts, target)
        for key, value in settings.items():
            _read_setting(key, value, target)
        if target.shader is not None:
            twice = next((key for key in sorted(target.extra) if key in target.shader.parameters), "")
            if twice:
                raise WrongText(f"'{twice}' is given twice")
        return target
    except WrongText as error:
        raise WrongText(f"'{text}': {error}") from None
