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
from voxelpipe._proto.voxelpipe.v1 import types_pb2 as types
from voxelpipe._proto.voxelpipe.v1 import voxelization_service_pb2 as service

from .. import shapes

MESH_ID = "0123456789abcdef" * 4
# In: the request or requests, and gRPC's context. Out: the responses, encoded.
Answer = Callable[[Any, Any], Iterable[bytes]]


class Liar(grpc.GenericRpcHandler):  # type: ignore[misc]
    """Answers each call by the function of its name, or of "" for any."""

    def __init__(self) -> None:
        self.answers: dict[str, Answer] = {}

    def service(self, details: Any) -> Any:
        name = details.method.rpartition("/")[2]
        answer = self.answers.get(name) or self.answers[""]
        many = name in ("Voxelize", "UploadMesh", "VoxelizeMany")
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


def piece(array: int, data: bytes, offset: int = 0) -> service.ResultPiece:
    """A piece with its CRC-32C."""
    return service.ResultPiece(target=array, offset=offset, data=data, crc32c=crc32c(data))


@dataclasses.dataclass
class Told:
    """The messages of a result. `extra`: further ones after the summary."""

    plan: service.VoxelizationPlan
    header: service.ResultHeader
    pieces: list[service.ResultPiece]
    summary: service.Summary
    first: list[service.VoxelizeResponse] = dataclasses.field(default_factory=list)
    extra: list[service.VoxelizeResponse] = dataclasses.field(default_factory=list)

    def hashed(self) -> None:
        """The summary has the SHA-256 of what the pieces hold."""
        self.summary.content_sha256 = hashlib.sha256(b"".join(one.data for one in self.pieces)).hexdigest()

    def whole(self) -> service.WholeResult:
        """All in one message."""
        return service.WholeResult(accepted=self.plan, header=self.header, pieces=self.pieces, summary=self.summary)

    def parts(self) -> list[service.VoxelizeResponse]:
        """One message each."""
        return [
            *self.first,
            service.VoxelizeResponse(accepted=self.plan),
            service.VoxelizeResponse(progress=service.Progress(stage="fill", fraction=0.5)),
            service.VoxelizeResponse(header=self.header),
            *(service.VoxelizeResponse(piece=one) for one in self.pieces),
            service.VoxelizeResponse(summary=self.summary),
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
OPTIONS: dict[str, Any] = {"resolution": 4, "targets": "triangle_id:u32"}


def honest(kind: str) -> Told:
    """A result for OPTIONS."""
    arrays = _ARRAYS[kind]
    return Told(
        service.VoxelizationPlan(grid=grid(4, 4, 4), result_bytes=256, backend="cpu"),
        service.ResultHeader(
            grid=grid(4, 4, 4),
            layout=types.LAYOUT_INTERLEAVED,
            kind=types.ResultKind.Value(f"RESULT_KIND_{kind.upper()}"),
            arrays=[
                service.ResultArray(name=name, element_type=element, shape=values.shape)
                for name, element, values in arrays
            ],
        ),
        [piece(i, values.tobytes()) for i, (_, _, values) in enumerate(arrays)],
        service.Summary(result_bytes=256),
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


def tell(liar: Liar, told: Told) -> None:
    """The result is the answer to all calls that voxelize."""
    info = service.GetServerInfoResponse(limits=service.ServerLimits(max_message_bytes=64 << 20))

    liar.answers = {
        "VoxelizeMesh": lambda *_: [part.SerializeToString() for part in told.parts()],
        "VoxelizeMany": lambda *_: [
            service.VoxelizeManyResponse(part=part).SerializeToString() for part in told.parts()
        ],
        "GetServerInfo": lambda *_: [info.SerializeToString()],
    }


def tell_whole(liar: Liar, told: Told) -> None:
    """The same in one message."""
    tell(liar, told)
    whole = told.whole()
    liar.answers["VoxelizeMesh"] = lambda *_: [service.VoxelizeResponse(whole=whole).SerializeToString()]
    liar.answers["VoxelizeMany"] = lambda *_: [service.VoxelizeManyResponse(whole=whole).SerializeToString()]


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
