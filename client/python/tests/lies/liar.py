"""A server that answers what a test wants, and honest results for it to change."""
from __future__ import annotations

import asyncio
import concurrent.futures
import dataclasses
import hashlib
from typing import Any, Callable, Iterable, Iterator

import numpy

from voxelpipe import AsyncClient, Client
from voxelpipe._calls.crc32c import crc32c
from voxelpipe._calls.grpc_module import grpc
from voxelpipe._proto.voxelpipe.v1 import request_pb2, result_pb2, server_info_pb2
from voxelpipe._proto.voxelpipe.v1 import types_pb2 as types
from voxelpipe._proto.voxelpipe.v1 import voxelization_service_pb2 as service

from .. import shapes

MESH_NAME = "meshes/" + "0123456789abcdef" * 4
# In: the request or requests, and gRPC's context. Out: the responses, encoded.
Answer = Callable[[Any, Any], Iterable[bytes]]


class Liar(grpc.GenericRpcHandler):  # type: ignore[misc]
    """Answers each call by the function of its name, or of "" for any; others are unknown to it."""

    def __init__(self) -> None:
        self.answers: dict[str, Answer] = {}

    def service(self, details: Any) -> Any:
        name = details.method.rpartition("/")[2]
        answer = self.answers.get(name) or self.answers.get("")
        if answer is None:
            return None
        many = name in ("VoxelizeUpload", "UploadMesh", "VoxelizeBatch")
        made = grpc.stream_stream_rpc_method_handler if many else grpc.unary_stream_rpc_method_handler
        return made(lambda request, context: iter(answer(request, context)))


def serve() -> Iterator[tuple[Liar, str]]:
    """A running server, and its address."""
    liar = Liar()
    made = grpc.server(concurrent.futures.ThreadPoolExecutor(4), handlers=[liar])
    port = made.add_insecure_port("127.0.0.1:0")
    made.start()
    yield liar, f"127.0.0.1:{port}"
    made.stop(None)


def grid(*dims: int) -> types.Grid:
    """A grid of voxels of size 1 at the origin."""
    return types.Grid(
        dims=types.Dims(x=dims[0], y=dims[1], z=dims[2]),
        origin=types.Vec3(),
        voxel_size=types.Vec3(x=1, y=1, z=1),
    )


def piece(array: int, data: bytes, offset: int = 0) -> result_pb2.ResultPiece:
    """A piece with its CRC-32C."""
    return result_pb2.ResultPiece(array=array, offset=offset, data=data, crc32c=crc32c(data))


Response = result_pb2.VoxelizeResponse
PROGRESS = result_pb2.Progress(stage="fill", fraction=0.5)


@dataclasses.dataclass
class Told:
    """The parts of a result. `first`, `extra`: further messages before it and after its summary."""

    plan: result_pb2.VoxelizationPlan
    header: result_pb2.ResultHeader
    pieces: list[result_pb2.ResultPiece]
    summary: result_pb2.Summary
    first: list[Response] = dataclasses.field(default_factory=list)
    extra: list[Response] = dataclasses.field(default_factory=list)

    def hashed(self) -> None:
        """The summary has the SHA-256 of what the pieces hold."""
        self.summary.content_sha256 = hashlib.sha256(b"".join(one.data for one in self.pieces)).hexdigest()

    def whole(self) -> Response:
        """All in one message."""
        return Response(plan=self.plan, header=self.header, pieces=self.pieces, summary=self.summary)

    def grouped(self) -> list[Response]:
        """Several parts a message."""
        return [
            *self.first,
            Response(plan=self.plan, progress=PROGRESS, header=self.header),
            Response(pieces=self.pieces),
            Response(summary=self.summary),
            *self.extra,
        ]

    def parts(self) -> list[Response]:
        """One message each."""
        return [
            *self.first,
            Response(plan=self.plan),
            Response(progress=PROGRESS),
            Response(header=self.header),
            *(Response(pieces=[one]) for one in self.pieces),
            Response(summary=self.summary),
            *self.extra,
        ]


_ARRAYS: dict[str, list[tuple[str, Any, Any]]] = {
    "dense": [("target0", types.ELEMENT_TYPE_U32, numpy.arange(64, dtype="<u4").reshape(4, 4, 4))],
    "sparse": [
        ("brick", types.ELEMENT_TYPE_U64, numpy.array([0], "<u8")),
        ("mask", types.ELEMENT_TYPE_U8, numpy.array([[3] + [0] * 63], "u1")),
        ("target0", types.ELEMENT_TYPE_U32, numpy.array([7, 9], "<u4")),
    ],
    "buckets": [
        ("voxel", types.ELEMENT_TYPE_U64, numpy.array([0, 5], "<u8")),
        ("offset", types.ELEMENT_TYPE_U64, numpy.array([0, 1, 3], "<u8")),
        ("triangle", types.ELEMENT_TYPE_U32, numpy.array([2, 0, 1], "<u4")),
        ("target0", types.ELEMENT_TYPE_U32, numpy.array([7, 9, 11], "<u4")),
    ],
}
_PARTS: list[tuple[str, Any, Any]] = [
    ("part_label", types.ELEMENT_TYPE_U32, numpy.array([3, 1, 1 << 31], "<u4")),
    ("part_priority", types.ELEMENT_TYPE_I32, numpy.array([0, -7, 5], "<i4")),
    ("part_triangles", types.ELEMENT_TYPE_U64, numpy.array([12, 4, 1 << 40], "<u8")),
    ("part_open_edges", types.ELEMENT_TYPE_U64, numpy.array([0, 3, 0], "<u8")),
    ("part_odd_columns", types.ELEMENT_TYPE_U64, numpy.array([0, 2, 0], "<u8")),
    ("part_voxels", types.ELEMENT_TYPE_U64, numpy.array([7, 0, 1 << 41], "<u8")),
    ("part_name_offset", types.ELEMENT_TYPE_U64, numpy.array([0, 4, 4, 9], "<u8")),
    ("part_name", types.ELEMENT_TYPE_U8, numpy.frombuffer("wingRäde".encode(), "u1")),
]
OPTIONS: dict[str, Any] = {"resolution": 4, "targets": "triangle_id:u32"}
PART_OPTIONS: dict[str, Any] = {"parts": "node", "fill": "parity"}


def honest(kind: str, parts: bool = False) -> Told:
    """A result for OPTIONS; with parts for PART_OPTIONS too, buckets without their fill."""
    unfilled = [one for one in _PARTS if one[0] not in ("part_open_edges", "part_odd_columns", "part_voxels")]
    table = unfilled if kind == "buckets" else _PARTS
    arrays = _ARRAYS[kind] + (table if parts else [])
    return Told(
        result_pb2.VoxelizationPlan(grid=grid(4, 4, 4), result_bytes=256, backend=types.BACKEND_CPU),
        result_pb2.ResultHeader(
            grid=grid(4, 4, 4),
            spec=request_pb2.VoxelizeSpec(
                layout=request_pb2.LAYOUT_INTERLEAVED,
                result=request_pb2.ResultKind.Value(f"RESULT_KIND_{kind.upper()}"),
            ),
            arrays=[
                result_pb2.ResultArray(name=name, element_type=element, shape=values.shape)
                for name, element, values in arrays
            ],
        ),
        [piece(i, values.tobytes()) for i, (_, _, values) in enumerate(arrays)],
        result_pb2.Summary(result_bytes=256),
    )


# Changes of a result.


def shaped(array: int, *shape: int) -> Callable[[Told], None]:
    def lie(told: Told) -> None:
        del told.header.arrays[array].shape[:]
        told.header.arrays[array].shape.extend(shape)

    return lie


def filled(array: int, values: Any) -> Callable[[Told], None]:
    def lie(told: Told) -> None:
        told.pieces[array].CopyFrom(piece(array, values.tobytes()))

    return lie


def gridded(field: str, axis: str, value: float) -> Callable[[Told], None]:
    def lie(told: Told) -> None:
        setattr(getattr(told.header.grid, field), axis, value)

    return lie


def replies(responses: Iterable[Response], number: int = 0) -> list[service.BatchReply]:
    """The replies of a job."""
    return [service.BatchReply(id=number, response=response) for response in responses]


def tell_responses(liar: Liar, responses: Iterable[Response], together: bool = False) -> None:
    """These are the answer to all calls that voxelize. together: to a batch in one message."""
    info = server_info_pb2.GetServerInfoResponse(limits=server_info_pb2.ServerLimits(max_message_bytes=64 << 20))
    listed = list(responses)
    batch = [replies(listed)] if together else [[reply] for reply in replies(listed)]
    liar.answers = {
        "Voxelize": lambda *_: [response.SerializeToString() for response in listed],
        "VoxelizeBatch": lambda *_: [service.VoxelizeBatchResponse(replies=r).SerializeToString() for r in batch],
        "GetServerInfo": lambda *_: [info.SerializeToString()],
    }


def tell(liar: Liar, told: Told) -> None:
    """The result is the answer, one part a message."""
    tell_responses(liar, told.parts())


def tell_grouped(liar: Liar, told: Told) -> None:
    """The same, several parts a message."""
    tell_responses(liar, told.grouped(), together=True)


def tell_whole(liar: Liar, told: Told) -> None:
    """The same in one message."""
    tell_responses(liar, [told.whole()])


def tell_batch(liar: Liar, *messages: list[service.BatchReply]) -> None:
    """These are the answer to a batch; single calls get an honest result."""
    tell(liar, honest("dense"))
    batch = [service.VoxelizeBatchResponse(replies=message) for message in messages]
    liar.answers["VoxelizeBatch"] = lambda *_: [message.SerializeToString() for message in batch]


def whole(number: int) -> list[service.BatchReply]:
    """The replies of a job with an honest result."""
    return replies([honest("dense").whole()], number)


def ask(address: str, **options: Any) -> Any:
    """A call of Client."""
    with Client(address, retries=0, timeout=20) as client:
        return client.voxelize(shapes.cube(), **{**OPTIONS, **options})


def ask_async(address: str, **options: Any) -> Any:
    """The same of AsyncClient."""

    async def run() -> Any:
        async with AsyncClient(address, retries=0, timeout=20) as client:
            return await client.voxelize(shapes.cube(), **{**OPTIONS, **options})

    return asyncio.run(run())


def ask_many(address: str, **options: Any) -> Any:
    """The same of Client.voxelize_many."""
    with Client(address, retries=0, timeout=20) as client:
        return list(client.voxelize_many([shapes.cube()], **{**OPTIONS, **options}))[0]
