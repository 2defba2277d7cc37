"""Colours of vertices as linear floats."""
from __future__ import annotations

from typing import Any

import numpy
import numpy.typing

from ..errors import InvalidMesh

Array = numpy.typing.NDArray[Any]


def _linear(srgb: Array) -> Array:
    """Linear values of sRGB ones from 0 to 1. Source: IEC 61966-2-1."""
    return numpy.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def _refuse_outside(array: Array, wrong: Array, what: str) -> None:
    if bool(wrong.any()):
        at = int(wrong.any(axis=1).argmax())
        raise InvalidMesh(f"colors[{at}] is {array[at].tolist()}; {what}", field="colors")


def linear_colors(array: Array, srgb_floats: bool = False) -> Array:
    """float32 of the same shape, (n, 3) or (n, 4). Integers are sRGB codes from 0 to 255; floats are from 0 to 1,
    linear or, with srgb_floats, sRGB. The fourth value is linear already. Errors: InvalidMesh naming the first wrong
    row.
    """
    if array.dtype.kind in "iu":
        _refuse_outside(array, (array < 0) | (array > 255), "integers are sRGB codes from 0 to 255")
        values = array / 255.0
    elif array.dtype.kind == "f":
        values = array.astype(numpy.float64)
        _refuse_outside(array, ~((values >= 0) & (values <= 1)), "floats are from 0 to 1")
    else:
        raise InvalidMesh(f"colors: {array.dtype} are no numbers", field="colors")
    if srgb_floats or array.dtype.kind in "iu":
        values[:, :3] = _linear(values[:, :3])
    return numpy.ascontiguousarray(values, "<f4")
