"""The option axes: which axes of the mesh those of the grid are. As core/request_text/axes.cpp."""
from __future__ import annotations

from typing import Any, Sequence

import numpy

from ..errors import InvalidRequest
from ..targets import Shader

_IDENTITY = (1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1)
_MATRICES = ("matrix", "matrix_previous")
_MOTION = ("linear_velocity", "angular_velocity", "center")
_Axis = tuple[int, int]  # one of the mesh, and its sign


def _wrong(why: str) -> InvalidRequest:
    return InvalidRequest(f"axes: {why}", field="axes")


def _parsed(text: str) -> tuple[_Axis, _Axis, _Axis]:
    parts = text.split(",")
    letters = [part[1:] if part[:1] in ("-", "+") else part for part in parts]
    if sorted(letters) != ["x", "y", "z"]:
        raise _wrong(f"'{text}' is not x, y and z, each once and perhaps negative, as in x,z,-y")
    x, y, z = (("xyz".index(letter), -1 if part[0] == "-" else 1) for letter, part in zip(letters, parts))
    return x, y, z


def _numbers(value: Any, count: int) -> list[float] | None:
    """None for a value that has not so many numbers."""
    if isinstance(value, str):
        return None
    numbers: list[float] = numpy.asarray(value, numpy.float64).ravel().tolist()
    return numbers if len(numbers) == count else None


def turned(axes: str | Sequence[str], shader: Shader | None) -> Shader | None:
    """The call of `transform` that gives what a vertex shader gives and then turns it; the shader itself where the axes
    stay, and with parameters that it does not take, so that the core says what is wrong with them as they were given.

    axes: such as "x,z,-y": the grid's y is the mesh's z. shader: None: identity. Errors: InvalidRequest.
    """
    if not isinstance(axes, str):
        try:
            axes = ",".join(axes)
        except TypeError:
            raise _wrong(f"{axes!r} is neither a text nor three") from None
    chosen = _parsed(axes)
    if chosen == ((0, 1), (1, 1), (2, 1)):
        return shader
    shader = shader or Shader("identity")
    if shader.name not in ("identity", "transform"):
        raise _wrong(
            f"turns the mesh by the vertex shader transform; '{shader.name}' cannot be turned: leave the axes out, or "
            "turn the mesh in its file"
        )
    given = dict(shader.parameters)
    if not set(given) <= {*_MOTION, *((*_MATRICES, "dt") if shader.name == "transform" else ())}:
        return shader
    parameters: dict[str, Any] = dict(given)
    for name in _MATRICES:
        matrix = _numbers(given.get(name, _IDENTITY), 16)
        if matrix is None:
            return shader
        rows = [[sign * number for number in matrix[4 * axis : 4 * axis + 4]] for axis, sign in chosen]
        parameters[name] = [number + 0.0 for number in [*sum(rows, []), *matrix[12:]]]  # none is -0
    permutation = [axis for axis, _ in chosen]
    even = permutation in ([0, 1, 2], [1, 2, 0], [2, 0, 1])
    handedness = (1 if even else -1) * chosen[0][1] * chosen[1][1] * chosen[2][1]
    for name in _MOTION:
        if name not in given:
            continue
        vector = _numbers(given[name], 3)
        if vector is None:
            return shader
        factor = handedness if name == "angular_velocity" else 1  # a pseudovector: a mirror turns it the other way
        parameters[name] = [factor * sign * vector[axis] + 0.0 for axis, sign in chosen]
    return Shader("transform", parameters)
