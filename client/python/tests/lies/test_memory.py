"""A server may announce more than it sends: memory is for what has arrived."""
from __future__ import annotations

import threading
import tracemalloc
from typing import Any, Callable, Iterator

import numpy
import pytest

import voxelpipe
from voxelpipe._calls import destination
from voxelpipe._calls.session import Options
from voxelpipe._proto.voxelpipe.v1 import result_pb2
from voxelpipe._proto.voxelpipe.v1 import types_pb2 as types

from .liar import Liar, Response, Told, ask, ask_async, ask_many, grid, honest, piece, shaped, tell, tell_whole

_MIB = 1 << 20


def peak_bytes(call: Callable[[], Any]) -> int:
    """The peak of what Python and numpy allocate meanwhile."""
    tracemalloc.start()
    try:
        call()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def announced(dims: tuple[int, int, int], element: Any) -> Told:
    """A result of a single piece of 1 MiB, whatever is announced."""
    result = honest("dense")
    for place in (result.plan.grid, result.header.grid):
        place.CopyFrom(grid(*dims))
    result.header.arrays[0].element_type = element
    shaped(0, *reversed(dims))(result)
    result.pieces = [piece(0, bytes(_MIB))]
    return result


@pytest.mark.parametrize("asked", [ask, ask_async, ask_many])
@pytest.mark.parametrize("packed", [False, True])
def test_bits_that_are_only_announced_take_no_memory(
    liar: tuple[Liar, str], packed: bool, asked: Callable[..., Any]
) -> None:
    tell(liar[0], announced((4096, 4096, 4096), types.ELEMENT_TYPE_BIT))  # 8 GiB, as bools 64 GiB

    def call() -> None:
        with pytest.raises(voxelpipe.DataLoss, match=f"it ended after {_MIB} of {8 << 30} bytes"):
            asked(liar[1], resolution=None, voxel_size=1, targets="bit", packed_bits=packed)

    assert peak_bytes(call) < 64 * _MIB


def test_bools_count_as_what_they_are_in_memory(liar: tuple[Liar, str]) -> None:
    tell(liar[0], announced((4096, 4096, 8192), types.ELEMENT_TYPE_BIT))

    def call() -> None:
        with pytest.raises(voxelpipe.TooLarge, match="max_result_bytes") as caught:
            ask(liar[1], resolution=None, voxel_size=1, targets="bit")
        assert (caught.value.need_bytes, caught.value.limit_bytes) == (128 << 30, 64 << 30)

    assert peak_bytes(call) < 64 * _MIB


def test_lists_that_are_only_announced_take_no_memory(liar: tuple[Liar, str]) -> None:
    result = honest("buckets")
    for place in (result.plan.grid, result.header.grid):
        place.CopyFrom(grid(4096, 4096, 4096))
    for array, count in enumerate([1 << 30, (1 << 30) + 1, 1 << 31, 1 << 31]):
        shaped(array, count)(result)
    result.pieces = [piece(0, bytes(_MIB))]
    tell(liar[0], result)

    def call() -> None:
        with pytest.raises(voxelpipe.DataLoss, match=f"it ended after {_MIB} of"):
            ask(liar[1], resolution=None, voxel_size=1, result="buckets")

    assert peak_bytes(call) < 64 * _MIB


@pytest.mark.parametrize("element, unpack", [("u32", False), ("bit", True), ("bit", False)])
def test_arrays_grow_with_what_arrives(element: str, unpack: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(destination, "_FIRST_BYTES", 16)
    shape = (13, 11, 97)
    array = destination.Destination(element, shape, unpack)
    data = numpy.random.default_rng(3).bytes(array.wire_bytes)
    for at in range(0, len(data), 7):
        array.write(at, data[at : at + 7])
    flat = numpy.frombuffer(data, numpy.uint8)
    if element == "u32":
        expected = flat.view("<u4").reshape(shape)
    else:
        bits = numpy.unpackbits(flat, bitorder="little", count=13 * 11 * 97).view(numpy.bool_).reshape(shape)
        expected = bits if unpack else flat
    assert array.array.dtype == expected.dtype and numpy.array_equal(array.array, expected)


def test_an_array_beyond_memory_is_too_large() -> None:
    for count in (1 << 56, 1 << 70):
        array = destination.Destination("u8", (count,), False)
        array.write(0, b"begin")
        with pytest.raises(voxelpipe.TooLarge, match=f"no memory for an array of {count} bytes"):
            array.array


def test_a_small_result_without_an_end(liar: tuple[Liar, str]) -> None:
    ended = threading.Event()

    def endless(_: Any, context: Any) -> Iterator[bytes]:
        context.add_callback(ended.set)
        progress = Response(progress=result_pb2.Progress(stage="x" * 1000)).SerializeToString()
        while context.is_active():
            yield progress

    liar[0].answers = {"Voxelize": endless}
    with pytest.raises(voxelpipe.DataLoss, match="bytes for a small one"):
        ask(liar[1])
    assert ended.wait(10)


def test_warnings_by_the_million(liar: tuple[Liar, str]) -> None:
    result = honest("dense")
    result.summary.warnings.extend([types.Warning(code=types.WARNING_CODE_NO_SCENE, text="x" * 1000)] * 3000)
    result.summary.warnings_left_out = (1 << 63) - 1
    result.summary.warnings[0].code = 12345
    tell_whole(liar[0], result)
    warnings = ask(liar[1]).warnings
    assert len(warnings) == 101 and warnings[0].code == "unknown" and len(warnings[1].text) == 256
    assert warnings[100].text == f"{(1 << 63) - 1 + 2900} further warnings"


def test_no_compressed_messages_are_taken() -> None:
    """One of them may expand a thousand times before anything of it can be checked."""
    assert ("grpc.compression_enabled_algorithms_bitset", 1) in Options("host:1").channel_options()
