"""Results that no honest server gives: each is an error of this package."""
from __future__ import annotations

import math
from typing import Any, Callable

import numpy
import pytest

import voxelpipe
from voxelpipe._calls.progress import Reporter
from voxelpipe._calls.wire import field
from voxelpipe._proto.voxelpipe.v1 import request_pb2, result_pb2
from voxelpipe._proto.voxelpipe.v1 import types_pb2 as types
from voxelpipe._proto.voxelpipe.v1 import voxelization_service_pb2 as service

from .liar import PROGRESS, Liar, Response, Told, ask, ask_async, ask_many, filled, gridded, honest, piece, shaped
from .liar import tell, tell_grouped, tell_responses, tell_whole

_INT64_MAX = (1 << 63) - 1
Way = Callable[..., Any]
WAYS: dict[str, tuple[Way, Way]] = {
    "parts": (tell, ask),
    "grouped": (tell_grouped, ask),
    "whole": (tell_whole, ask),
    "async-parts": (tell, ask_async),
    "async-grouped": (tell_grouped, ask_async),
    "async-whole": (tell_whole, ask_async),
    "many-parts": (tell, ask_many),
    "many-grouped": (tell_grouped, ask_many),
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
            setattr(told.header.spec, name, value)

    return lie


def pieced(**fields: Any) -> Callable[[Told], None]:
    def lie(told: Told) -> None:
        for name, value in fields.items():
            setattr(told.pieces[0], name, value)

    return lie


def zipped(raw: bytes, size: int, then: bytes = b"", cut: int = 0) -> Callable[[Told], None]:
    def lie(told: Told) -> None:
        zstandard = pytest.importorskip("zstandard")
        frame = zstandard.ZstdCompressor().compress(raw) + then
        told.pieces[0].CopyFrom(piece(0, frame[: len(frame) - cut]))
        told.pieces[0].uncompressed_bytes = size

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


def no_spec(told: Told) -> None:
    told.header.ClearField("spec")


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
    "huge components": (shaped(0, 4, 4, 4, _INT64_MAX), "dense", "target0 is u32 of shape"),
    "huge list": (shaped(0, _INT64_MAX), "sparse", f"{_INT64_MAX} bricks in a grid of 1"),
    "negative components": (shaped(0, 4, 4, 4, -1), "dense", "target0 has a shape of -1 elements"),
    "negative layers": (shaped(0, -4, 4, 4), "dense", "target0 has a shape of -4 elements"),
    "negative and planes": (shaped(0, -4, -4, 4), "dense", "target0 has a shape of -4 elements"),
    "negative list": (shaped(0, -1), "sparse", "brick has a shape of -1 elements"),
    "negative values": (shaped(2, -1 << 63), "sparse", f"target0 has a shape of {-1 << 63} elements"),
    "negative buckets": (
        both(shaped(0, -5), shaped(1, -4), shaped(2, -3), shaped(3, -3)),
        "buckets",
        "voxel has a shape of -5 elements",
    ),
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
    "another kind": (headed(result=request_pb2.RESULT_KIND_SPARSE), "dense", "a result of kind 2, requested was 1"),
    "unknown kind": (headed(result=-7), "dense", "a result of kind -7, requested was 1"),
    "no spec": (no_spec, "dense", "a result of kind 0, requested was 1"),
    "another layout": (headed(layout=request_pb2.LAYOUT_PLANAR), "dense", "a result of layout 2, requested was 1"),
    "no layout": (headed(layout=0), "sparse", "a result of layout 0, requested was 1"),
    "unknown layout": (headed(layout=99), "sparse", "a result of layout 99, requested was 1"),
    "more arrays": (more_arrays, "dense", "2 arrays instead of 1"),
    "no arrays": (no_arrays, "buckets", "0 arrays instead of 4"),
    "another name": (renamed, "dense", "an array that is not 'target0' in its place"),
    "arrays in another order": (swapped, "sparse", "an array that is not 'brick' in its place"),
    "another type": (typed(types.ELEMENT_TYPE_F32), "dense", "target0 is f32 of shape"),
    "no type": (typed(types.ELEMENT_TYPE_UNSPECIFIED), "dense", "target0 is unspecified of shape"),
    "unknown type": (typed(1 << 30), "dense", "an array of the unknown type 1073741824"),
    "bits as a list": (typed(types.ELEMENT_TYPE_BIT), "sparse", "brick is bit of shape"),
    "piece of another array": (pieced(array=2_000_000_000), "dense", "a piece of array 2000000000 at offset 0"),
    "piece of a negative array": (pieced(array=-1), "dense", "a piece of array -1 at offset 0"),
    "piece at another offset": (pieced(offset=_INT64_MAX), "dense", f"at offset {_INT64_MAX}"),
    "piece at a negative offset": (pieced(offset=-256), "dense", "at offset -256"),
    "piece without bytes": (pieced(data=b""), "dense", "a piece without bytes"),
    "piece that is too long": (filled(0, numpy.zeros(257, "u1")), "dense", "is too long"),
    "another checksum": (pieced(crc32c=1), "dense", "the CRC32C of the piece at offset 0 of array 0 does not match"),
    "a piece twice": (twice, "dense", "more bytes than announced"),
    "no pieces": (no_pieces, "dense", "it ended after 0 of 256 bytes"),
    "huge compressed piece": (pieced(uncompressed_bytes=_INT64_MAX), "dense", "is too long"),
    "compressed piece of nothing": (pieced(uncompressed_bytes=0), "dense", "a compressed piece of 0 bytes"),
    "negative compressed piece": (pieced(uncompressed_bytes=-256), "dense", "a compressed piece of -256 bytes"),
    "no frame": (pieced(uncompressed_bytes=256), "dense", "a compressed piece is broken|announced size"),
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


def again(message: Callable[[Told], Response], first: bool = False) -> Callable[[Told], None]:
    return lambda told: (told.first if first else told.extra).append(message(told))


# Only where a result comes in several messages.
DISORDER: dict[str, tuple[Callable[[Told], None], str]] = {
    "two plans": (again(lambda told: Response(plan=told.plan), True), "a second plan"),
    "two headers": (again(lambda told: Response(header=told.header), True), "a plan after the header"),
    "piece first": (again(lambda told: Response(pieces=[told.pieces[0]]), True), "before the header"),
    "summary first": (again(lambda told: Response(summary=told.summary), True), "before the header"),
    "whole first": (again(lambda told: told.whole(), True), "a message after its summary"),
    "progress that is no number": (
        again(lambda _: Response(progress=result_pb2.Progress(fraction=math.nan)), True),
        "a progress that is no number",
    ),
}
LATE: dict[str, tuple[Callable[[Told], None], str]] = {
    "two summaries": (again(lambda told: Response(summary=told.summary)), "a message after its summary"),
    "piece last": (again(lambda told: Response(pieces=[told.pieces[0]])), "more bytes than announced"),
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


# The parts of each message.
ORDERS: dict[str, tuple[list[str], str]] = {
    "pieces without a header": (["plan", "pieces", "summary"], "a piece before the header"),
    "all but the header": (["plan+pieces+summary"], "a piece before the header"),
    "a summary without a header": (["plan+progress+summary"], "a summary before the header"),
    "a header and a summary": (["header+summary"], "it ended after 0 of 256 bytes"),
    "a summary before the pieces": (["header", "summary", "pieces"], "it ended after 0 of 256 bytes"),
    "a plan after the header": (["header", "plan", "pieces", "summary"], "a plan after the header"),
    "a plan with the pieces": (["header", "plan+pieces+summary"], "a plan after the header"),
    "two headers": (["header", "header", "pieces", "summary"], "a second header"),
    "a header with the summary": (["header", "pieces", "header+summary"], "a second header"),
}
AFTER_THE_END = {
    "nothing": "",
    "progress": "progress",
    "a plan": "plan",
    "a header": "header",
    "a summary": "summary",
    "all again": "plan+header+pieces+summary",
}


def ordered(order: list[str]) -> list[Response]:
    told = honest("dense")
    fields = {
        "plan": told.plan,
        "progress": PROGRESS,
        "header": told.header,
        "pieces": told.pieces,
        "summary": told.summary,
    }
    names = [[name for name in message.split("+") if name] for message in order]
    return [Response(**{name: fields[name] for name in message}) for message in names]  # type: ignore[arg-type]


@pytest.mark.parametrize("asked", [ask, ask_async, ask_many])
@pytest.mark.parametrize("lie", ORDERS)
def test_parts_out_of_order(liar: tuple[Liar, str], lie: str, asked: Way) -> None:
    order, text = ORDERS[lie]
    tell_responses(liar[0], ordered(order), together=len(order) > 2)
    with pytest.raises(voxelpipe.DataLoss, match=text):
        asked(liar[1])


@pytest.mark.parametrize("asked", [ask, ask_async])
@pytest.mark.parametrize("lie", AFTER_THE_END)
def test_messages_after_the_summary(liar: tuple[Liar, str], lie: str, asked: Way) -> None:
    tell_responses(liar[0], ordered(["header+pieces+summary", AFTER_THE_END[lie]]))
    with pytest.raises(voxelpipe.DataLoss, match="a message after its summary"):
        asked(liar[1])


@pytest.mark.parametrize("asked", [ask, ask_async, ask_many])
def test_two_headers_in_one_message(liar: tuple[Liar, str], asked: Way) -> None:
    told = honest("dense")
    rest = Response(pieces=told.pieces, summary=told.summary).SerializeToString()
    message = 2 * Response(header=told.header).SerializeToString() + rest
    tell(liar[0], told)
    liar[0].answers["Voxelize"] = lambda *_: [message]
    reply = b"".join(field(service.BatchReply.RESPONSE_FIELD_NUMBER, [message]))
    batch = b"".join(field(service.VoxelizeBatchResponse.REPLIES_FIELD_NUMBER, [reply]))
    liar[0].answers["VoxelizeBatch"] = lambda *_: [batch]
    with pytest.raises(voxelpipe.DataLoss, match="2 arrays instead of 1"):
        asked(liar[1])


def test_an_end_without_a_summary(liar: tuple[Liar, str]) -> None:
    tell(liar[0], honest("dense"))
    for count in range(4):
        parts = [part.SerializeToString() for part in honest("dense").parts()[:count]]
        liar[0].answers["Voxelize"] = lambda *_, parts=parts: parts
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


# Fields of a summary.
COUNTS = [
    *(f"stats.{name}" for name in ("triangles", "fragments", "occupied", "odd_columns", "triangles_outside")),
    *(f"stats.{name}" for name in ("batch_jobs", "attempts")),
    *(f"report.{name}" for name in ("triangles", "vertices", "degenerate_triangles", "open_edges")),
    *("peak_bytes", "result_bytes", "sent_bytes", "warnings_left_out"),
]
TIMES = ["voxelize_time", "voxelize_cpu_time", "queue_time", "stages"]
NO_TIMES = [(-1, 0), (0, -1), (1, -1), (-1, 999_999_999), (1 << 62, 0), (-1 << 63, 0), (0, 10**9), (0, (1 << 31) - 1)]


@pytest.mark.parametrize("asked", [ask, ask_async, ask_many])
@pytest.mark.parametrize("path", COUNTS)
def test_negative_counts(liar: tuple[Liar, str], path: str, asked: Way) -> None:
    told = honest("dense")
    *outer, name = path.split(".")
    for count in (-1, -1 << (31 if name in ("batch_jobs", "attempts") else 63)):
        setattr(getattr(told.summary, outer[0]) if outer else told.summary, name, count)
        tell_whole(liar[0], told)
        with pytest.raises(voxelpipe.DataLoss, match=f"{name} is {count}"):
            asked(liar[1])


@pytest.mark.parametrize("asked", [ask, ask_async, ask_many])
@pytest.mark.parametrize("name", TIMES)
def test_times_that_are_none(liar: tuple[Liar, str], name: str, asked: Way) -> None:
    for seconds, nanos in NO_TIMES:
        told = honest("dense")
        stats = told.summary.stats
        time = stats.stages.add(stage="fill").time if name == "stages" else getattr(stats, name)
        time.seconds, time.nanos = seconds, nanos
        tell_whole(liar[0], told)
        with pytest.raises(voxelpipe.DataLoss, match=f"time is {seconds} s and {nanos} ns"):
            asked(liar[1])


@pytest.mark.parametrize("asked", [ask, ask_async, ask_many])
@pytest.mark.parametrize("name", ["result_bytes", "peak_bytes"])
def test_a_plan_of_a_negative_size(liar: tuple[Liar, str], name: str, asked: Way) -> None:
    told = honest("dense")
    setattr(told.plan, name, -1)
    tell(liar[0], told)
    with pytest.raises(voxelpipe.DataLoss, match="a plan of a negative size"):
        asked(liar[1])


@pytest.mark.parametrize(
    "backend, simd, names",
    [
        (types.BACKEND_CPU, types.SIMD_AVX2, ("cpu", "avx2")),
        (types.BACKEND_CUDA, types.SIMD_UNSPECIFIED, ("cuda", "cuda")),
        (types.BACKEND_UNSPECIFIED, types.SIMD_UNSPECIFIED, ("", "")),
        (77, -3, ("unknown", "unknown")),
    ],
)
def test_enums_of_a_summary_are_texts(liar: tuple[Liar, str], backend: Any, simd: Any, names: tuple[str, str]) -> None:
    told = honest("dense")
    told.summary.stats.backend, told.summary.stats.simd = backend, simd
    told.summary.stats.voxelize_time.seconds, told.summary.stats.voxelize_time.nanos = 1, 500_000
    tell_whole(liar[0], told)
    summary = ask(liar[1]).summary
    assert (summary.backend, summary.simd) == names and summary.voxelize_ms == 1000.5


def test_progress_stays_between_0_and_1() -> None:
    shown: list[float] = []
    reporter = Reporter(lambda _, fraction, __: shown.append(fraction))
    for fraction in (-1.0, 1e300, -math.inf, math.inf):
        reporter(f"{fraction}", fraction, 0)
    assert shown == [0, 1, 0, 1]
