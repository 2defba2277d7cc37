"""Results that no honest server gives: each is an error of this package."""
from __future__ import annotations

import math
from typing import Any, Callable

import numpy
import pytest

import voxelpipe
from voxelpipe._calls.progress import Reporter
from voxelpipe._proto.voxelpipe.v1 import types_pb2 as types
from voxelpipe._proto.voxelpipe.v1 import voxelization_service_pb2 as service

from .liar import Liar, Told, ask, ask_async, ask_many, filled, gridded, honest, piece, shaped, tell, tell_whole

Way = Callable[..., Any]
WAYS: dict[str, tuple[Way, Way]] = {
    "parts": (tell, ask),
    "whole": (tell_whole, ask),
    "async-parts": (tell, ask_async),
    "async-whole": (tell_whole, ask_async),
    "many-parts": (tell, ask_many),
    "many-whole": (tell_whole, ask_many),
}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("kind", ["dense", "sparse", "buckets"])
def test_the_honest_results_are_taken(liar: tuple[Liar, str], kind: str, way: str) -> None:
    told, asked = WAYS[way]
    told(liar[0], honest(kind))
    result = asked(liar[1], result=kind)
    assert result.kind == kind and result.dims == (4, 4, 4) and result.target0.nbytes in (256, 8, 12)


def planned(field: str, axis: str, value: float) -> Callable[[Told], None]:
    def lie(told: Told) -> None:
        setattr(getattr(told.plan.grid, field), axis, value)

    return lie


def headed(**fields: Any) -> Callable[[Told], None]:
    def lie(told: Told) -> None:
        for name, value in fields.items():
            setattr(told.header, name, value)

    return lie


def pieced(array: int = 0, **fields: Any) -> Callable[[Told], None]:
    def lie(told: Told) -> None:
        for name, value in fields.items():
            setattr(told.pieces[array], name, value)

    return lie


def zipped(raw: bytes, raw_bytes: int, then: bytes = b"", cut: int = 0) -> Callable[[Told], None]:
    def lie(told: Told) -> None:
        zstandard = pytest.importorskip("zstandard")
        frame = zstandard.ZstdCompressor().compress(raw) + then
        told.pieces[0].CopyFrom(piece(0, frame[: len(frame) - cut]))
        told.pieces[0].raw_bytes = raw_bytes

    return lie


def both(*lies: Callable[[Told], None]) -> Callable[[Told], None]:
    def lie(told: Told) -> None:
        for one in lies:
            one(told)

    return lie


def more_arrays(told: Told) -> None:
    told.header.arrays.add().CopyFrom(told.header.arrays[0])


def renamed(told: Told) -> None:
    told.header.arrays[0].name = "x" * 100_000


def swapped(told: Told) -> None:
    told.header.arrays[0].CopyFrom(told.header.arrays[1])


def no_grid(told: Told) -> None:
    told.header.ClearField("grid")


def no_arrays(told: Told) -> None:
    told.header.ClearField("arrays")


def typed(element: Any) -> Callable[[Told], None]:
    def lie(told: Told) -> None:
        told.header.arrays[0].element_type = element

    return lie


def no_pieces(told: Told) -> None:
    told.pieces.clear()


def twice(told: Told) -> None:
    told.pieces.append(told.pieces[0])


# What is changed, the kind of result, and what the error says.
LIES: dict[str, tuple[Callable[[Told], None], str, str]] = {
    "no shape": (shaped(0), "dense", "target0 has a shape of 0 numbers"),
    "no shape of a list": (shaped(0), "sparse", "brick has a shape of 0 numbers"),
    "no shape of the offsets": (shaped(1), "buckets", "offset has a shape of 0 numbers"),
    "no shape of the triangles": (shaped(2), "buckets", "triangle has a shape of 0 numbers"),
    "no shape of a sparse target": (shaped(2), "sparse", "target0 has a shape of 0 numbers"),
    "a shape of many numbers": (shaped(0, *[1] * 100_000), "dense", "target0 has a shape of 100000 numbers"),
    "another shape": (shaped(0, 4, 4, 5), "dense", r"target0 is u32 of shape \(4, 4, 5\)"),
    "five components": (shaped(0, 4, 4, 4, 5), "dense", "target0 is u32 of shape"),
    "no components": (shaped(0, 4, 4, 4, 0), "dense", "target0 is u32 of shape"),
    "huge components": (shaped(0, 4, 4, 4, (1 << 64) - 1), "dense", "target0 is u32 of shape"),
    "huge list": (shaped(0, (1 << 64) - 1), "sparse", "18446744073709551615 bricks in a grid of 1"),
    "more values than voxels": (shaped(2, 65), "sparse", "65 voxels listed in a grid of 64"),
    "more values than bricks hold": (shaped(2, 513), "sparse", "513 voxels in 1 bricks"),
    "fewer values than bricks": (shaped(2, 0), "sparse", "0 voxels in 1 bricks"),
    "other values than the masks have": (
        both(shaped(2, 3), filled(2, numpy.zeros(3, "<u4"))),
        "sparse",
        "the masks have 2 voxels, which is not the announced number of values, 3",
    ),
    "two-dimensional list": (shaped(0, 1, 1), "sparse", r"brick is u64 of shape \(1, 1\)"),
    "masks of another size": (shaped(1, 1, 63), "sparse", r"mask is u8 of shape \(1, 63\)"),
    "offsets of another size": (shaped(1, 2), "buckets", r"offset is u64 of shape \(2,\)"),
    "more voxels than fragments": (shaped(2, 1), "buckets", "1 fragments in 2 voxels"),
    "more fragments than any mesh": (shaped(2, 1 << 60), "buckets", f"{1 << 60} fragments in 2 voxels"),
    "more voxels than the grid": (
        both(shaped(0, 65), shaped(2, 70)),
        "buckets",
        "65 voxels listed in a grid of 64",
    ),
    "no grid": (no_grid, "dense", "a grid of 0 x [04] x [04] voxels"),
    "negative dims": (gridded("dims", "y", -4), "dense", "a grid of 4 x -4 x 4 voxels"),
    "huge dims": (gridded("dims", "z", 1 << 62), "dense", "a grid of 4 x 4 x 4611686018427387904 voxels"),
    "dims above the resolution": (gridded("dims", "x", 5), "dense", "requested was resolution 4"),
    "origin that is no number": (gridded("origin", "x", math.nan), "dense", "origin is not finite"),
    "infinite origin": (gridded("origin", "z", -math.inf), "dense", "origin is not finite"),
    "voxel size 0": (gridded("voxel_size", "x", 0), "dense", "voxel size is not positive"),
    "negative voxel size": (gridded("voxel_size", "y", -1), "dense", "voxel size is not positive"),
    "voxel size that is no number": (gridded("voxel_size", "z", math.nan), "dense", "voxel size is not positive"),
    "infinite voxel size": (gridded("voxel_size", "z", math.inf), "dense", "voxel size is not positive"),
    "plan without voxels": (planned("dims", "x", 0), "dense", "a grid of 0 x [04] x [04] voxels"),
    "plan that is no number": (planned("origin", "x", math.nan), "dense", "origin is not finite"),
    "another kind": (headed(kind=types.RESULT_KIND_SPARSE), "dense", "a result of kind 2, requested was 1"),
    "unknown kind": (headed(kind=-7), "dense", "a result of kind -7, requested was 1"),
    "another layout": (headed(layout=types.LAYOUT_PLANAR), "dense", "a result of layout 2, requested was 1"),
    "unknown layout": (headed(layout=99), "sparse", "a result of layout 99, requested was 1"),
    "more arrays": (more_arrays, "dense", "2 arrays instead of 1"),
    "no arrays": (no_arrays, "buckets", "0 arrays instead of 4"),
    "another name": (renamed, "dense", "an array that is not 'target0' in its place"),
    "arrays in another order": (swapped, "sparse", "an array that is not 'brick' in its place"),
    "another type": (typed(types.ELEMENT_TYPE_F32), "dense", "target0 is f32 of shape"),
    "no type": (typed(types.ELEMENT_TYPE_UNSPECIFIED), "dense", "target0 is unspecified of shape"),
    "unknown type": (typed(1 << 30), "dense", "an array of the unknown type 1073741824"),
    "bits as a list": (typed(types.ELEMENT_TYPE_BIT), "sparse", "brick is bit of shape"),
    "piece of another array": (pieced(target=4_000_000_000), "dense", "a piece of array 4000000000 at offset 0"),
    "piece at another offset": (pieced(offset=(1 << 64) - 1), "dense", "at offset 18446744073709551615"),
    "piece without bytes": (pieced(data=b""), "dense", "a piece without bytes"),
    "piece that is too long": (filled(0, numpy.zeros(257, "u1")), "dense", "is too long"),
    "another checksum": (pieced(crc32c=1), "dense", "the CRC32C of the piece at offset 0 of array 0 does not match"),
    "a piece twice": (twice, "dense", "more bytes than announced"),
    "no pieces": (no_pieces, "dense", "it ended after 0 of 256 bytes"),
    "huge compressed piece": (pieced(raw_bytes=1 << 63), "dense", "is too long"),
    "no frame": (pieced(raw_bytes=256), "dense", "a compressed piece is broken|announced size"),
    "frame that expands further": (zipped(bytes(1 << 20), 256), "dense", "not one zstd frame of the announced size"),
    "frame that holds less": (zipped(bytes(255), 256), "dense", "not one zstd frame of the announced size"),
    "frame that is cut": (zipped(bytes(range(256)), 256, cut=4), "dense", "a compressed piece is broken"),
    "bytes after a frame": (zipped(bytes(256), 256, then=b"more"), "dense", "a compressed piece is broken"),
    "bricks outside": (filled(0, numpy.array([1], "<u8")), "sparse", "brick does not ascend below 1"),
    "voxels of a mask outside": (
        filled(1, numpy.array([0x81] + [0] * 63, "u1")),
        "sparse",
        "a mask has voxels outside of the grid",
    ),
    "empty mask": (filled(1, numpy.zeros(64, "u1")), "sparse", "a mask is empty"),
    "voxels that fall": (filled(0, numpy.array([5, 5], "<u8")), "buckets", "voxel does not ascend below 64"),
    "huge voxel": (filled(0, numpy.array([5, -1], "<i8")), "buckets", "voxel does not ascend below 64"),
    "huge offset": (filled(1, numpy.array([0, -1, 3], "<i8")), "buckets", "offsets do not ascend from 0 to 3"),
    "offsets from 1": (filled(1, numpy.array([1, 2, 3], "<u8")), "buckets", "offsets do not ascend from 0 to 3"),
    "triangles that fall": (filled(2, numpy.array([2, 1, 0], "<u4")), "buckets", "do not ascend within a voxel"),
}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("lie", LIES)
def test_a_result_that_is_no_result(liar: tuple[Liar, str], lie: str, way: str) -> None:
    change, kind, text = LIES[lie]
    told, asked = WAYS[way]
    result = honest(kind)
    change(result)
    told(liar[0], result)
    with pytest.raises(voxelpipe.DataLoss, match=text) as caught:
        asked(liar[1], result=kind)
    assert len(str(caught.value)) < 300


def again(message: Callable[[Told], service.VoxelizeResponse], first: bool = False) -> Callable[[Told], None]:
    return lambda told: (told.first if first else told.extra).append(message(told))


# Only where a result comes in several messages.
DISORDER: dict[str, tuple[Callable[[Told], None], str]] = {
    "two plans": (again(lambda told: service.VoxelizeResponse(accepted=told.plan), True), "a second plan"),
    "two headers": (again(lambda told: service.VoxelizeResponse(header=told.header), True), "a second header"),
    "piece first": (again(lambda told: service.VoxelizeResponse(piece=told.pieces[0]), True), "before the header"),
    "summary first": (again(lambda told: service.VoxelizeResponse(summary=told.summary), True), "before the header"),
    "whole first": (again(lambda told: service.VoxelizeResponse(whole=told.whole()), True), "a second (plan|header)"),
    "progress that is no number": (
        again(lambda _: service.VoxelizeResponse(progress=service.Progress(fraction=math.nan)), True),
        "a progress that is no number",
    ),
}
LATE: dict[str, tuple[Callable[[Told], None], str]] = {
    "two summaries": (again(lambda told: service.VoxelizeResponse(summary=told.summary)), "a second summary"),
    "piece last": (again(lambda told: service.VoxelizeResponse(piece=told.pieces[0])), "more bytes than announced"),
}


@pytest.mark.parametrize("asked", [ask, ask_async])
@pytest.mark.parametrize("lie", [*DISORDER, *LATE])
def test_messages_out_of_order(liar: tuple[Liar, str], lie: str, asked: Way) -> None:
    change, text = {**DISORDER, **LATE}[lie]
    result = honest("dense")
    change(result)
    tell(liar[0], result)
    with pytest.raises(voxelpipe.DataLoss, match=text):
        asked(liar[1])


@pytest.mark.parametrize("lie", [name for name in DISORDER if name != "whole first"])
def test_messages_out_of_order_of_many(liar: tuple[Liar, str], lie: str) -> None:
    change, text = DISORDER[lie]
    result = honest("dense")
    change(result)
    tell(liar[0], result)
    with pytest.raises(voxelpipe.DataLoss, match=text):
        ask_many(liar[1])


def test_an_end_without_a_summary(liar: tuple[Liar, str]) -> None:
    tell(liar[0], honest("dense"))
    for count in range(4):
        parts = [part.SerializeToString() for part in honest("dense").parts()[:count]]
        liar[0].answers["VoxelizeMesh"] = lambda *_, parts=parts: parts
        for asked in (ask, ask_async):
            with pytest.raises(voxelpipe.DataLoss, match="it ended before its summary"):
                asked(liar[1])


@pytest.mark.parametrize("way", WAYS)
def test_another_sha256(liar: tuple[Liar, str], way: str) -> None:
    told, asked = WAYS[way]
    result = honest("dense")
    result.summary.content_sha256 = "\x1b[31m" + "f" * 100_000
    told(liar[0], result)
    with pytest.raises(voxelpipe.DataLoss, match="its SHA-256 is not the announced one"):
        asked(liar[1], content_hash=True)


def test_progress_stays_between_0_and_1() -> None:
    shown: list[float] = []
    reporter = Reporter(lambda _, fraction, __: shown.append(fraction))
    for fraction in (-1.0, 1e300, -math.inf, math.inf):
        reporter(f"{fraction}", fraction, 0)
    assert shown == [0, 1, 0, 1]
