"""The arrays of parts in a result. As ReadParts of proto/wire and CheckParts of core/job."""
from __future__ import annotations

from typing import TYPE_CHECKING, Any, Mapping, Sequence

import numpy
import numpy.typing

from .._proto.voxelpipe.v1 import request_pb2
from ..part_table import Parts
from .wire import lost

if TYPE_CHECKING:
    from ..request import Request

_MAX_PARTS = 65_535
_MAX_NAME_BYTES = 1 << 32  # above the names of any file
_FILLED = ("part_open_edges", "part_odd_columns", "part_voxels")
ELEMENTS = {
    "part_label": "u32",
    "part_priority": "i32",
    "part_triangles": "u64",
    **dict.fromkeys(_FILLED, "u64"),
    "part_name_offset": "u64",
    "part_name": "u8",
}

Array = numpy.typing.NDArray[Any]
Shape = tuple[int, ...]


def names_of(filled: bool) -> list[str]:
    """The arrays, in stream order. filled: each part is filled by itself."""
    return [name for name in ELEMENTS if filled or name not in _FILLED]


def expected_names(request: "Request", arrays: int, others: int) -> list[str]:
    """The arrays of parts that follow the `others` in a result of so many arrays. None where the mesh has no parts."""
    if not request.has_parts or arrays <= others:
        return []
    return names_of(request.spec.fill in (request_pb2.FILL_PARITY, request_pb2.FILL_NONZERO))


def shapes_of(names: Sequence[str], parts: int, name_bytes: int) -> dict[str, Shape]:
    """The shapes of these arrays. Errors: DataLoss for more parts or bytes than a mesh has."""
    if not 1 <= parts <= _MAX_PARTS:
        raise lost(f"{parts} parts")
    if name_bytes > _MAX_NAME_BYTES:
        raise lost(f"{name_bytes} bytes of names of parts")
    special: dict[str, Shape] = {"part_name_offset": (parts + 1,), "part_name": (name_bytes,)}
    return {name: special.get(name, (parts,)) for name in names}


def check_shapes(names: Sequence[str], elements: Sequence[str], shapes: Sequence[Shape]) -> None:
    """In: what a result announces for the arrays of these names; no shape is empty. Errors: DataLoss naming one."""
    if not names:
        return
    expected = shapes_of(names, shapes[0][0], shapes[-1][0])
    for name, element, shape in zip(names, elements, shapes):
        if (element, shape) != (ELEMENTS[name], expected[name]):
            raise lost(f"its array {name} is {element} of shape {shape}")


def read_parts(arrays: Mapping[str, Array]) -> Parts | None:
    """The table of these arrays, whose shapes were checked; None if there are none. Errors: DataLoss naming an array
    and its element.
    """
    if not arrays:
        return None
    numbers: dict[str, Array] = {}
    for name, array in arrays.items():
        numbers[name] = array.view("<i8") if ELEMENTS[name] == "u64" else array
        wrong = numpy.flatnonzero(numbers[name] < (1 if name == "part_label" else 0))
        if name != "part_priority" and len(wrong):
            raise lost(f"{name}[{wrong[0]}] is {array[wrong[0]]}")
    offset, texts = numbers["part_name_offset"], numbers["part_name"]
    if int(offset[0]) != 0 or int(offset[-1]) != len(texts) or bool((offset[1:] < offset[:-1]).any()):
        raise lost(f"its part_name_offset does not ascend from 0 to {len(texts)}")
    encoded, ends = texts.tobytes(), offset.tolist()
    return Parts(
        label=numbers["part_label"],
        priority=numbers["part_priority"],
        triangles=numbers["part_triangles"],
        open_edges=numbers.get("part_open_edges"),
        odd_columns=numbers.get("part_odd_columns"),
        voxels=numbers.get("part_voxels"),
        name=[encoded[begin:end].decode(errors="replace") for begin, end in zip(ends, ends[1:])],
        _name_offset=offset,
        _name_bytes=texts,
    )
