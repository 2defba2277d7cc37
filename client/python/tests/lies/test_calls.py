"""Answers and errors that no honest server gives, of all calls: each is an error of this package."""
from __future__ import annotations

import asyncio
from typing import Any, Callable, Iterable

import pytest

import voxelpipe
from voxelpipe import AsyncClient, Client
from voxelpipe._calls.grpc_module import grpc
from voxelpipe._calls.status import of_call
from voxelpipe._proto.google.rpc import error_details_pb2, status_pb2
from voxelpipe._proto.voxelpipe.v1 import voxelization_service_pb2 as service

from .. import shapes
from .liar import MESH_ID, Liar, ask_many, grid, gridded, honest, tell

CALLS: dict[str, tuple[str, Callable[[Any], Any]]] = {
    "estimate": ("EstimateVoxelization", lambda client: client.estimate(shapes.cube())),
    "shaders": ("ListShaders", lambda client: client.shaders()),
    "server_info": ("GetServerInfo", lambda client: client.server_info()),
    "stored_mesh": ("GetMesh", lambda client: client.stored_mesh(MESH_ID)),
    "delete_mesh": ("DeleteMesh", lambda client: client.delete_mesh(MESH_ID)),
    "upload": ("UploadMesh", lambda client: client.upload(shapes.cube())),
    "voxelize": ("VoxelizeMesh", lambda client: client.voxelize(shapes.cube(), resolution=4)),
}


def call(address: str, name: str, asynchronous: bool) -> Any:
    if not asynchronous:
        with Client(address, retries=1, timeout=20) as client:
            return CALLS[name][1](client)

    async def run() -> Any:
        async with AsyncClient(address, retries=1, timeout=20) as client:
            return await CALLS[name][1](client)

    return asyncio.run(run())


BOTH = pytest.mark.parametrize("asynchronous", [False, True])


@BOTH
@pytest.mark.parametrize("name", CALLS)
@pytest.mark.filterwarnings("ignore:Unexpected end-group tag:RuntimeWarning")
def test_bytes_that_are_no_message(liar: tuple[Liar, str], name: str, asynchronous: bool) -> None:
    for junk in (b"\xff" * 9, b"\x0cabc", b"\x0a\xff", b"\x0a\x02\xc3\x28"):
        liar[0].answers = {CALLS[name][0]: lambda *_, junk=junk: [junk]}
        try:
            call(liar[1], name, asynchronous)
        except voxelpipe.DataLoss as error:
            assert "cannot be read" in str(error) or "names no mesh" in str(error) or "a grid of 0" in str(error)
        else:
            assert junk[0] == 10 and name == "delete_mesh"  # a field that the message does not have


@BOTH
@pytest.mark.parametrize("name", CALLS)
def test_an_end_without_a_message(liar: tuple[Liar, str], name: str, asynchronous: bool) -> None:
    liar[0].answers = {CALLS[name][0]: lambda *_: []}
    with pytest.raises(voxelpipe.VoxelpipeError):
        call(liar[1], name, asynchronous)


ANSWERS: dict[str, tuple[str, Any, str]] = {
    "an estimate without a plan": ("estimate", service.EstimateVoxelizationResponse(), "a grid of 0 x 0 x 0 voxels"),
    "an estimate of a huge grid": (
        "estimate",
        service.EstimateVoxelizationResponse(plan=service.VoxelizationPlan(grid=grid(1 << 20, 1 << 20, 1 << 20))),
        "a grid beyond 2\\^53 voxels",
    ),
    "a mesh without an id": ("stored_mesh", service.GetMeshResponse(), "'' names no mesh"),
    "a mesh of a wrong id": (
        "stored_mesh",
        service.GetMeshResponse(mesh=service.StoredMesh(mesh_id="\x1b" * 64)),
        "names no mesh",
    ),
    "an upload of nothing": ("upload", service.UploadMeshResponse(), "'' names no mesh"),
    "an upload of another mesh": (
        "upload",
        service.UploadMeshResponse(mesh=service.StoredMesh(mesh_id=MESH_ID)),
        f"the server keeps the mesh [0-9a-f]+ as {MESH_ID}",
    ),
}


@BOTH
@pytest.mark.parametrize("answer", ANSWERS)
def test_an_answer_that_cannot_be(liar: tuple[Liar, str], answer: str, asynchronous: bool) -> None:
    name, message, text = ANSWERS[answer]
    liar[0].answers = {CALLS[name][0]: lambda *_: [message.SerializeToString()]}
    with pytest.raises(voxelpipe.DataLoss, match=text):
        call(liar[1], name, asynchronous)


@BOTH
def test_unknown_numbers_of_enums_and_negative_counts_are_told(liar: tuple[Liar, str], asynchronous: bool) -> None:
    plan = service.VoxelizationPlan(grid=grid(1, 1, 1), time_class=-5, slab_depth=-1)  # type: ignore[arg-type]
    answers = {
        "EstimateVoxelization": service.EstimateVoxelizationResponse(plan=plan),
        "ListShaders": service.ListShadersResponse(
            shaders=[service.ShaderInfo(stage=77, output_components=-3)]  # type: ignore[arg-type]
        ),
        "GetServerInfo": service.GetServerInfoResponse(
            devices=[service.Device(state=-1, memory_bytes=(1 << 64) - 1)]  # type: ignore[arg-type]
        ),
    }
    liar[0].answers = {name: lambda *_, m=m: [m.SerializeToString()] for name, m in answers.items()}
    assert call(liar[1], "estimate", asynchronous).time_class == ""
    assert call(liar[1], "shaders", asynchronous)[0].stage == "fragment"
    assert call(liar[1], "server_info", asynchronous).devices[0].serving


# ---- many ----


def many(liar: Liar, *responses: service.VoxelizeManyResponse) -> None:
    tell(liar, honest("dense"))
    liar.answers["VoxelizeMany"] = lambda *_: [response.SerializeToString() for response in responses]


def whole(number: int) -> service.VoxelizeManyResponse:
    return service.VoxelizeManyResponse(id=number, whole=honest("dense").whole())


UNKNOWN_JOBS = {
    "index out of range": [whole((1 << 64) - 1)],
    "answered twice": [whole(0), whole(0)],
    "answered twice in one message": [service.VoxelizeManyResponse(id=1, whole=whole(1).whole, more=[whole(1)])],
}


@pytest.mark.parametrize("lie", UNKNOWN_JOBS)
def test_an_answer_to_no_job(liar: tuple[Liar, str], lie: str) -> None:
    many(liar[0], *UNKNOWN_JOBS[lie])
    with Client(liar[1], retries=0, timeout=20) as client:
        options: dict[str, Any] = {"resolution": 4, "targets": "triangle_id:u32", "in_flight": 2}
        with pytest.raises(voxelpipe.DataLoss, match="to job [0-9]+, which waits for none"):
            list(client.voxelize_many([shapes.cube()] * 2, **options))
        results = list(client.voxelize_many([shapes.cube()] * 2, errors="return", **options))
        assert len(results) == 2 and any(isinstance(result, voxelpipe.DataLoss) for result in results)


def test_jobs_without_an_answer_are_made_alone(liar: tuple[Liar, str]) -> None:
    many(liar[0], whole(1))
    with Client(liar[1], retries=0, timeout=20) as client:
        results = list(client.voxelize_many([shapes.cube()] * 2, resolution=4, targets="triangle_id:u32", in_flight=2))
    assert results[0] == results[1]


def test_a_whole_result_as_a_part_of_many(liar: tuple[Liar, str]) -> None:
    part = service.VoxelizeResponse(whole=honest("dense").whole())
    many(liar[0], service.VoxelizeManyResponse(id=0, part=part))
    assert ask_many(liar[1]).dims == (4, 4, 4)


def test_the_rest_of_a_refused_result_is_left_out(liar: tuple[Liar, str]) -> None:
    broken = honest("dense")
    gridded("voxel_size", "x", 0)(broken)
    parts = [service.VoxelizeManyResponse(id=0, part=part) for part in broken.parts()]
    many(liar[0], *parts, whole(1))
    with Client(liar[1], retries=0, timeout=20) as client:
        results = list(
            client.voxelize_many(
                [shapes.cube()] * 2, resolution=4, targets="triangle_id:u32", in_flight=2, errors="return"
            )
        )
    assert isinstance(results[0], voxelpipe.DataLoss) and isinstance(results[1], voxelpipe.VoxelGrid)


def test_bytes_that_are_no_message_of_many(liar: tuple[Liar, str]) -> None:
    tell(liar[0], honest("dense"))
    liar[0].answers["VoxelizeMany"] = lambda *_: [b"\xff" * 9]
    with pytest.raises(voxelpipe.DataLoss, match="cannot be read"):
        ask_many(liar[1])


@pytest.mark.parametrize("most_bytes", [0, 1000])
def test_messages_without_room_for_a_job(liar: tuple[Liar, str], most_bytes: int) -> None:
    tell(liar[0], honest("dense"))
    info = service.GetServerInfoResponse(limits=service.ServerLimits(max_message_bytes=most_bytes))
    liar[0].answers["GetServerInfo"] = lambda *_: [info.SerializeToString()]
    with pytest.raises(voxelpipe.DataLoss, match=f"messages of at most {most_bytes} bytes"):
        ask_many(liar[1])


def test_an_error_of_the_code_ok(liar: tuple[Liar, str]) -> None:
    many(liar[0], service.VoxelizeManyResponse(id=0, error=status_pb2.Status(code=0, message="fine")))
    with pytest.raises(voxelpipe.DataLoss, match="an error of the code OK"):
        ask_many(liar[1])


# ---- errors ----


def retry_info(seconds: int, nanos: int = 0) -> Any:
    info = error_details_pb2.RetryInfo()
    info.retry_delay.seconds, info.retry_delay.nanos = seconds, nanos
    return info


def limits(**metadata: str) -> Any:
    return error_details_pb2.ErrorInfo(metadata=metadata)


def detailed(*details: Any) -> Any:
    made = status_pb2.Status(code=8, message="refused")
    for detail in details:
        if isinstance(detail, str):
            made.details.add(type_url=f"type.googleapis.com/google.rpc.{detail}", value=b"\xff" * 5)
        else:
            made.details.add().Pack(detail)
    return made


DIGITS = "9" * 1000  # all trailers together have at most 8 KiB
DETAILS: dict[str, tuple[Any, type[voxelpipe.VoxelpipeError], dict[str, Any]]] = {
    "a RetryInfo that is no message": (detailed("RetryInfo"), voxelpipe.TooLarge, {"limit_bytes": None}),
    "all details are no messages": (
        detailed("BadRequest", "ErrorInfo", "RetryInfo", "QuotaFailure", "ResourceInfo"),
        voxelpipe.TooLarge,
        {"need_bytes": None},
    ),
    "a negative delay": (detailed(retry_info(-5)), voxelpipe.Overloaded, {"retry_after": 0.0}),
    "negative nanoseconds": (detailed(retry_info(0, -1)), voxelpipe.Overloaded, {"retry_after": 0.0}),
    "a delay of ages": (detailed(retry_info(1 << 62)), voxelpipe.Overloaded, {"retry_after": 3600.0}),
    "a quota of an unknown client": (
        detailed(retry_info(0), error_details_pb2.QuotaFailure()),
        voxelpipe.QuotaExceeded,
        {"subject": ""},
    ),
    "numbers of a thousand digits": (
        detailed(limits(limit_bytes=DIGITS, need_bytes=DIGITS, largest_resolution=DIGITS, smallest_voxel_size=DIGITS)),
        voxelpipe.TooLarge,
        {"limit_bytes": None, "need_bytes": None, "largest_resolution": None, "smallest_voxel_size": None},
    ),
    "numbers that are none": (
        detailed(limits(limit_bytes="-1", need_bytes="1e9", largest_resolution="", smallest_voxel_size="1,2")),
        voxelpipe.TooLarge,
        {"limit_bytes": None, "need_bytes": None, "largest_resolution": None, "smallest_voxel_size": None},
    ),
    "a size that is none": (
        detailed(limits(limit_bytes="7", smallest_voxel_size="nan,1,1")),
        voxelpipe.TooLarge,
        {"limit_bytes": 7, "smallest_voxel_size": None},
    ),
    "an infinite size": (
        detailed(limits(limit_bytes="7", smallest_voxel_size="1,inf,1")),
        voxelpipe.TooLarge,
        {"smallest_voxel_size": None},
    ),
    "a negative size": (
        detailed(limits(limit_bytes="7", smallest_voxel_size="1,1,-1")),
        voxelpipe.TooLarge,
        {"smallest_voxel_size": None},
    ),
}


def refuse(liar: Liar, code: Any, text: str, *trailers: tuple[str, Any]) -> None:
    def fail(_: Any, context: Any) -> Iterable[bytes]:
        context.set_trailing_metadata(trailers)
        context.abort(code, text)
        return []

    liar.answers = {"": fail}


@BOTH
@pytest.mark.parametrize("name", ["server_info", "upload", "voxelize"])
@pytest.mark.parametrize("lie", DETAILS)
def test_details_that_cannot_be(liar: tuple[Liar, str], lie: str, name: str, asynchronous: bool) -> None:
    details, kind, fields = DETAILS[lie]
    trailer = ("grpc-status-details-bin", details.SerializeToString())
    refuse(liar[0], grpc.StatusCode.RESOURCE_EXHAUSTED, "refused", trailer)
    with pytest.raises(kind, match="refused") as caught:
        call(liar[1], name, asynchronous)
    assert type(caught.value) is kind and {field: getattr(caught.value, field) for field in fields} == fields


@pytest.mark.parametrize("lie", DETAILS)
def test_details_of_many_that_cannot_be(liar: tuple[Liar, str], lie: str) -> None:
    details, kind, _ = DETAILS[lie]
    many(liar[0], service.VoxelizeManyResponse(id=0, error=details))
    trailer = ("grpc-status-details-bin", details.SerializeToString())
    refused = grpc.StatusCode.RESOURCE_EXHAUSTED

    def fail(_: Any, context: Any) -> Iterable[bytes]:
        context.set_trailing_metadata([trailer])
        context.abort(refused, "refused")
        return []

    liar[0].answers["VoxelizeMesh"] = fail  # a busy server is asked again, alone
    with pytest.raises(kind, match="refused"):
        ask_many(liar[1])


def test_a_number_of_six_thousand_digits(liar: tuple[Liar, str]) -> None:
    details = detailed(limits(limit_bytes="9" * 6000, largest_resolution="\u0663" * 6000))
    many(liar[0], service.VoxelizeManyResponse(id=0, error=details))
    with pytest.raises(voxelpipe.TooLarge, match="refused") as caught:
        ask_many(liar[1])
    assert caught.value.limit_bytes is None and caught.value.largest_resolution is None


PUSH_BACKS = {"-1": 0.0, "nan": 0.0, "1e999": 3600.0, DIGITS: 3600.0, "x": None, "": None}


@BOTH
@pytest.mark.parametrize("number", range(len(PUSH_BACKS)))
def test_push_back_that_cannot_be(liar: tuple[Liar, str], number: int, asynchronous: bool) -> None:
    pushback, delay = list(PUSH_BACKS.items())[number]
    trailers = [("grpc-retry-pushback-ms", pushback), ("grpc-status-details-bin", b"\xff" * 9)]
    made = of_call("UNAVAILABLE", "away", trailers, "server", "")
    assert isinstance(made, voxelpipe.Unavailable) and made.retry_after == delay
    refuse(liar[0], grpc.StatusCode.UNAVAILABLE, "away", *trailers)  # gRPC itself changes some of them
    with pytest.raises(voxelpipe.Unavailable, match="away") as caught:
        call(liar[1], "server_info", asynchronous)
    assert caught.value.retry_after is None or 0 <= caught.value.retry_after <= 3600


@BOTH
@pytest.mark.parametrize("code", [code for code in grpc.StatusCode if code.value[0]])
def test_every_code_is_an_error_of_this_package(liar: tuple[Liar, str], code: Any, asynchronous: bool) -> None:
    refuse(liar[0], code, "\x1b]0;caf\u00e9\n\x00", ("grpc-status-details-bin", b""))
    for name in ("server_info", "upload"):
        with pytest.raises(voxelpipe.VoxelpipeError) as caught:
            call(liar[1], name, asynchronous)
        # A gRPC server that shuts down ends new calls with CANCELLED: they are made again.
        assert caught.value.code == ("UNAVAILABLE" if code.name == "CANCELLED" else code.name)
