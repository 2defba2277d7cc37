"""Arrays of parts that no honest server sends: each is an error of this package."""
from __future__ import annotations

from typing import Any, Callable

import numpy
import pytest

import voxelpipe
from voxelpipe import Client
from voxelpipe._proto.voxelpipe.v1 import types_pb2 as types

from .. import shapes
from .liar import OPTIONS, PART_OPTIONS, Liar, Told, ask, filled, honest, shaped, tell
from .test_results import WAYS

# Of a dense result.
LABEL, PRIORITY, TRIANGLES, OPEN_EDGES, ODD_COLUMNS, VOXELS, NAME_OFFSET, NAME = range(1, 9)
_INT64_MAX = (1 << 63) - 1


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("kind", ["dense", "sparse", "buckets"])
def test_the_honest_parts_are_taken(liar: tuple[Liar, str], kind: str, way: str) -> None:
    told, asked = WAYS[way]
    told(liar[0], honest(kind, parts=True))
    options = {**PART_OPTIONS, "fill": "none"} if kind == "buckets" else PART_OPTIONS
    parts = asked(liar[1], result=kind, **options).parts
    assert parts.name == ["wing", "", "Räde"] and len(parts) == 3
    assert parts.label.dtype == numpy.uint32 and parts.label.tolist() == [3, 1, 1 << 31]
    assert parts.priority.dtype == numpy.int32 and parts.priority.tolist() == [0, -7, 5]
    assert parts.triangles.dtype == numpy.int64 and parts.triangles.tolist() == [12, 4, 1 << 40]
    counts = (parts.open_edges, parts.odd_columns, parts.voxels)
    if kind == "buckets":
        assert counts == (None, None, None)
    else:
        assert all(count.dtype == numpy.int64 for count in counts)
        assert [count.tolist() for count in counts] == [[0, 3, 0], [0, 2, 0], [7, 0, 1 << 41]]


def test_a_mesh_without_triangles_has_no_parts(liar: tuple[Liar, str]) -> None:
    tell(liar[0], honest("dense"))
    assert ask(liar[1], **PART_OPTIONS).parts is None


def typed(array: int, element: Any) -> Callable[[Told], None]:
    def lie(told: Told) -> None:
        told.header.arrays[array].element_type = element

    return lie


def named(array: int, name: str) -> Callable[[Told], None]:
    def lie(told: Told) -> None:
        told.header.arrays[array].name = name

    return lie


def without(*arrays: int) -> Callable[[Told], None]:
    def lie(told: Told) -> None:
        for array in sorted(arrays, reverse=True):
            del told.header.arrays[array]

    return lie


def swapped(told: Told) -> None:
    told.header.arrays[OPEN_EDGES].name, told.header.arrays[VOXELS].name = "part_voxels", "part_open_edges"


def all_shaped(parts: int) -> Callable[[Told], None]:
    def lie(told: Told) -> None:
        for array in range(LABEL, NAME):
            shaped(array, parts + (array == NAME_OFFSET))(told)

    return lie


def numbers(array: int, *values: int) -> Callable[[Told], None]:
    dtype = {LABEL: "<u4", PRIORITY: "<i4"}.get(array, "<u8")
    return filled(array, numpy.array(values, dtype))


# What is changed, and what the error says.
LIES: dict[str, tuple[Callable[[Told], None], str]] = {
    "no names": (without(NAME), "8 arrays instead of 9"),
    "the label alone": (without(*range(PRIORITY, NAME + 1)), "2 arrays instead of 9"),
    "as without a fill": (without(OPEN_EDGES, ODD_COLUMNS, VOXELS), "6 arrays instead of 9"),
    "another name": (named(PRIORITY, "part_weight"), "an array that is not 'part_priority' in its place"),
    "another order": (swapped, "an array that is not 'part_open_edges' in its place"),
    "labels of 16 bits": (typed(LABEL, types.ELEMENT_TYPE_U16), r"part_label is u16 of shape \(3,\)"),
    "priorities without a sign": (typed(PRIORITY, types.ELEMENT_TYPE_U32), r"part_priority is u32 of shape \(3,\)"),
    "names of bits": (typed(NAME, types.ELEMENT_TYPE_BIT), r"part_name is bit of shape \(9,\)"),
    "unknown type": (typed(VOXELS, 1 << 20), "an array of the unknown type 1048576"),
    "no shape": (shaped(LABEL), "part_label has a shape of 0 numbers"),
    "no shape of the names": (shaped(NAME), "part_name has a shape of 0 numbers"),
    "two dimensions": (shaped(TRIANGLES, 3, 1), r"part_triangles is u64 of shape \(3, 1\)"),
    "fewer priorities": (shaped(PRIORITY, 2), r"part_priority is i32 of shape \(2,\)"),
    "more voxels": (shaped(VOXELS, 4), r"part_voxels is u64 of shape \(4,\)"),
    "as many offsets as parts": (shaped(NAME_OFFSET, 3), r"part_name_offset is u64 of shape \(3,\)"),
    "no parts": (all_shaped(0), "0 parts"),
    "more parts than possible": (all_shaped(65_536), "65536 parts"),
    "more parts than numbers": (all_shaped(_INT64_MAX - 1), f"{_INT64_MAX - 1} parts"),
    "negative parts": (all_shaped(-3), "part_label has a shape of -3 elements"),
    "names longer than any": (shaped(NAME, (1 << 32) + 1), "4294967297 bytes of names of parts"),
    "a negative name": (shaped(NAME, -1), "part_name has a shape of -1 elements"),
    "label 0": (numbers(LABEL, 3, 0, 1), r"part_label\[1\] is 0"),
    "offsets from 1": (numbers(NAME_OFFSET, 1, 4, 4, 9), "part_name_offset does not ascend from 0 to 9"),
    "offsets that fall": (numbers(NAME_OFFSET, 0, 5, 4, 9), "part_name_offset does not ascend from 0 to 9"),
    "offsets beyond the names": (numbers(NAME_OFFSET, 0, 4, 10, 9), "part_name_offset does not ascend from 0 to 9"),
    "offsets that end early": (numbers(NAME_OFFSET, 0, 4, 4, 8), "part_name_offset does not ascend from 0 to 9"),
    "huge offset": (numbers(NAME_OFFSET, 0, 4, (1 << 64) - 1, 9), rf"part_name_offset\[2\] is {(1 << 64) - 1}"),
    "huge count": (numbers(VOXELS, 1, 2, 1 << 63), rf"part_voxels\[2\] is {1 << 63}"),
}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("lie", LIES)
def test_parts_that_are_none(liar: tuple[Liar, str], lie: str, way: str) -> None:
    change, text = LIES[lie]
    told, asked = WAYS[way]
    result = honest("dense", parts=True)
    change(result)
    told(liar[0], result)
    with pytest.raises(voxelpipe.DataLoss, match=text) as caught:
        asked(liar[1], **PART_OPTIONS)
    assert len(str(caught.value)) < 300


@pytest.mark.parametrize("way", WAYS)
def test_parts_that_were_not_asked_for(liar: tuple[Liar, str], way: str) -> None:
    told, asked = WAYS[way]
    told(liar[0], honest("dense", parts=True))
    others: list[dict[str, Any]] = [{}, {"fill": "parity"}, {"parts": "whole"}]
    for options in others:
        with pytest.raises(voxelpipe.DataLoss, match="9 arrays instead of 1"):
            asked(liar[1], **options)
    with pytest.raises(voxelpipe.DataLoss, match="9 arrays instead of 6"):
        asked(liar[1], parts="material")


def test_names_that_are_no_text_are_shown(liar: tuple[Liar, str]) -> None:
    result = honest("dense", parts=True)
    filled(NAME, numpy.frombuffer(b"w\xffng\xc3B\x00se", "u1"))(result)
    tell(liar[0], result)
    parts = ask(liar[1], **PART_OPTIONS).parts
    assert parts.name == ["w\ufffdng", "", "\ufffdB\0se"]
    assert "\0" not in repr(parts)


def test_the_largest_result_counts_parts(liar: tuple[Liar, str]) -> None:
    tell(liar[0], honest("dense", parts=True))
    bytes_of_parts = 3 * (4 + 4 + 4 * 8) + 4 * 8 + 9
    with Client(liar[1], max_result_bytes=255 + bytes_of_parts) as client:
        with pytest.raises(voxelpipe.TooLarge) as caught:
            client.voxelize(shapes.cube(), **OPTIONS, **PART_OPTIONS)
    assert caught.value.need_bytes == 256 + bytes_of_parts
    with Client(liar[1], max_result_bytes=256 + bytes_of_parts) as client:
        assert client.voxelize(shapes.cube(), **OPTIONS, **PART_OPTIONS).nbytes == 256 + bytes_of_parts
