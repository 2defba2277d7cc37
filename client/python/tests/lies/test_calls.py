"""Answers and errors that no honest server gives, of all calls: each is an error of this package."""
from __future__ import annotations

import asyncio
import math
from typing import Any, Callable, Iterable

import pytest

import voxelpipe
from voxelpipe import AsyncClient, Client
from voxelpipe._calls.grpc_module import grpc
from voxelpipe._calls.status import of_call
from voxelpipe._proto.google.rpc import error_details_pb2, status_pb2
from voxelpipe._proto.voxelpipe.v1 import error_pb2, mesh_pb2, result_pb2, server_info_pb2
from voxelpipe._proto.voxelpipe.v1 import types_pb2 as types
from voxelpipe._proto.voxelpipe.v1 import voxelization_service_pb2 as service
from voxelpipe._version import CONTRACT_REVISION

from .. import shapes
from .liar import MESH_NAME, Liar, ask_many, grid, tell_batch


def meshes(client: Any) -> Any:
    async def listed() -> list[Any]:
        return [mesh async for mesh in client.meshes()]

    return listed() if isinstance(client, AsyncClient) else list(client.meshes())


CALLS: dict[str, tuple[str, Callable[[Any], Any]]] = {
    "estimate": ("EstimateVoxelization", lambda client: client.estimate(shapes.cube())),
    "shaders": ("ListShaders", lambda client: client.shaders()),
    "server_info": ("GetServerInfo", lambda client: client.server_info()),
    "stored_mesh": ("GetMesh", lambda client: client.stored_mesh(MESH_NAME)),
    "meshes": ("ListMeshes", meshes),
    "release_mesh": ("ReleaseMesh", lambda client: client.release_mesh(MESH_NAME)),
    "upload": ("UploadMesh", lambda client: client.upload(shapes.cube())),
    "voxelize": ("Voxelize", lambda client: client.voxelize(shapes.cube(), resolution=4)),
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
            assert junk[0] == 10 and name == "release_mesh"  # a field that the message does not have


@BOTH
@pytest.mark.parametrize("name", CALLS)
def test_an_end_without_a_message(liar: tuple[Liar, str], name: str, asynchronous: bool) -> None:
    liar[0].answers = {CALLS[name][0]: lambda *_: []}
    with pytest.raises(voxelpipe.VoxelpipeError):
        call(liar[1], name, asynchronous)


def estimated(**fields: Any) -> service.EstimateVoxelizationResponse:
    fields.setdefault("grid", grid(1, 1, 1))
    return service.EstimateVoxelizationResponse(plan=result_pb2.VoxelizationPlan(**fields))


def informed(**fields: Any) -> server_info_pb2.GetServerInfoResponse:
    return server_info_pb2.GetServerInfoResponse(**fields)


def mesh(**fields: Any) -> mesh_pb2.Mesh:
    fields.setdefault("name", MESH_NAME)
    return mesh_pb2.Mesh(**fields)


def paged(*listed: mesh_pb2.Mesh, token: str = "") -> mesh_pb2.ListMeshesResponse:
    return mesh_pb2.ListMeshesResponse(meshes=listed, next_page_token=token)


# The call, its answer, and what the error says.
ANSWERS: dict[str, tuple[str, Any, str]] = {
    "an estimate without a plan": ("estimate", service.EstimateVoxelizationResponse(), "a grid of 0 x 0 x 0 voxels"),
    "an estimate of a huge grid": (
        "estimate",
        estimated(grid=grid(1 << 20, 1 << 20, 1 << 20)),
        "a grid beyond 2\\^53 voxels",
    ),
    "an estimate of negative bytes": ("estimate", estimated(result_bytes=-1), "result_bytes is -1"),
    "an estimate of a negative peak": ("estimate", estimated(peak_bytes=-1 << 63), f"peak_bytes is {-1 << 63}"),
    "negative components": (
        "shaders",
        server_info_pb2.ListShadersResponse(shaders=[server_info_pb2.ShaderInfo(output_components=-3)]),
        "output_components is -3",
    ),
    "a negative limit": (
        "server_info",
        informed(limits=server_info_pb2.ServerLimits(max_result_bytes=-1)),
        "max_result_bytes is -1",
    ),
    "negative threads": ("server_info", informed(threads=-2), "threads is -2"),
    "a negative revision": ("server_info", informed(contract_revision=-1), "contract_revision is -1"),
    "negative memory": (
        "server_info",
        informed(devices=[server_info_pb2.Device(memory_bytes=-1 << 63)]),
        f"memory_bytes is {-1 << 63}",
    ),
    "negative workers": ("server_info", informed(devices=[server_info_pb2.Device(workers=-1)]), "workers is -1"),
    "a mesh without a name": ("stored_mesh", mesh(name=""), "'' names no mesh"),
    "a mesh of a wrong name": ("stored_mesh", mesh(name="\x1b" * 80), "names no mesh"),
    "a mesh of half a name": ("stored_mesh", mesh(name=MESH_NAME[7:]), "names no mesh"),
    "a mesh of an unknown unit": ("stored_mesh", mesh(name=f"{MESH_NAME}-km"), "names no mesh"),
    "a mesh of a format before its unit": ("stored_mesh", mesh(name=f"{MESH_NAME}-obj-mm"), "names no mesh"),
    "a mesh with a line end": ("stored_mesh", mesh(name=f"{MESH_NAME}\n"), "names no mesh"),
    "a mesh of negative bytes": ("stored_mesh", mesh(file_bytes=-1), "file_bytes is -1"),
    "a mesh of negative memory": ("stored_mesh", mesh(memory_bytes=-7), "memory_bytes is -7"),
    "a mesh of negative triangles": (
        "stored_mesh",
        mesh(report=types.MeshReport(triangles=-1)),
        "triangles is -1",
    ),
    "a list with a mesh of negative uses": ("meshes", paged(mesh(), mesh(uses=-1)), "uses is -1"),
    "a list with a mesh without a name": ("meshes", paged(mesh(), mesh(name="")), "'' names no mesh"),
    "a list that begins again": ("meshes", paged(mesh(), token="again"), "a list of meshes without an end"),
    "a list of empty pages": ("meshes", paged(token="next"), "a list of meshes without an end"),
    "negative freed bytes": ("release_mesh", mesh_pb2.ReleaseMeshResponse(freed_bytes=-1), "freed_bytes is -1"),
    "an upload of nothing": ("upload", mesh_pb2.Mesh(), "'' names no mesh"),
    "an upload of another mesh": ("upload", mesh(), f"the server keeps the mesh meshes/[0-9a-f]+ as {MESH_NAME}"),
}


@BOTH
@pytest.mark.parametrize("answer", ANSWERS)
def test_an_answer_that_cannot_be(liar: tuple[Liar, str], answer: str, asynchronous: bool) -> None:
    name, message, text = ANSWERS[answer]
    liar[0].answers = {CALLS[name][0]: lambda *_: [message.SerializeToString()]}
    with pytest.raises(voxelpipe.DataLoss, match=text):
        call(liar[1], name, asynchronous)


@BOTH
def test_unknown_numbers_of_enums_are_told(liar: tuple[Liar, str], asynchronous: bool) -> None:
    shader = server_info_pb2.ShaderInfo(
        stage=77, output_type=99, parameters=[server_info_pb2.ShaderParameterInfo(type=-1)]  # type: ignore[arg-type]
    )
    device = server_info_pb2.Device(state=-1, backend=55)  # type: ignore[arg-type]
    answers = {
        "EstimateVoxelization": estimated(time_class=-5, backend=1 << 30),
        "ListShaders": server_info_pb2.ListShadersResponse(shaders=[shader]),
        "GetServerInfo": informed(
            devices=[device],
            backends=[server_info_pb2.BackendInfo(backend=9, simd=9)],  # type: ignore[arg-type]
        ),
    }
    liar[0].answers = {name: lambda *_, m=m: [m.SerializeToString()] for name, m in answers.items()}
    estimate = call(liar[1], "estimate", asynchronous)
    assert (estimate.time_class, estimate.backend) == ("unknown", "unknown")
    told = call(liar[1], "shaders", asynchronous)[0]
    assert (told.stage, told.output_type, told.parameters[0].type) == ("fragment", "unknown", "unknown")
    info = call(liar[1], "server_info", asynchronous)
    assert info.devices[0].serving and info.devices[0].backend == "unknown" and info.backends == {"unknown": "unknown"}


@BOTH
def test_enums_of_a_server_are_texts(liar: tuple[Liar, str], asynchronous: bool) -> None:
    kinds: Any = [number for _, number in server_info_pb2.ShaderParameterType.items()]
    shaders = [
        server_info_pb2.ShaderInfo(name="move", stage=server_info_pb2.SHADER_STAGE_VERTEX),
        server_info_pb2.ShaderInfo(
            stage=server_info_pb2.SHADER_STAGE_FRAGMENT,
            output_type=types.ELEMENT_TYPE_U32,
            parameters=[server_info_pb2.ShaderParameterInfo(type=kind, default_values=[1, 2]) for kind in kinds[1:]],
        ),
    ]
    answers = {
        "ListShaders": server_info_pb2.ListShadersResponse(shaders=shaders),
        "GetServerInfo": informed(
            contract_revision=3,
            backends=[
                server_info_pb2.BackendInfo(backend=types.BACKEND_CUDA),
                server_info_pb2.BackendInfo(backend=types.BACKEND_CPU, simd=types.SIMD_AVX512),
            ],
            limits=server_info_pb2.ServerLimits(load_workers=2, batch_jobs=64),
        ),
    }
    liar[0].answers = {name: lambda *_, m=m: [m.SerializeToString()] for name, m in answers.items()}
    move, other = call(liar[1], "shaders", asynchronous)
    assert (move.stage, move.output_type) == ("vertex", "position")
    assert (other.stage, other.output_type, other.parameters[0].default) == ("fragment", "u32", (1, 2))
    assert [one.type for one in other.parameters] == "float floats vec3 vec4 mat4 uint string".split()
    info = call(liar[1], "server_info", asynchronous)
    assert info.contract_revision == 3 and info.backends == {"cuda": "cuda", "cpu": "avx512"}
    assert info.limits["load_workers"] == 2 and info.limits["batch_jobs"] == 64


@BOTH
def test_the_pages_of_a_list_are_followed(liar: tuple[Liar, str], asynchronous: bool) -> None:
    names = [f"meshes/{number:064x}-in-3mf" for number in range(5)]
    asked = []

    def answer(request: bytes, _: Any) -> Iterable[bytes]:
        token = mesh_pb2.ListMeshesRequest.FromString(request).page_token
        asked.append(token)
        at = int(token or 0)
        page = paged(*(mesh(name=name) for name in names[at : at + 2]), token=str(at + 2) if at + 2 < 5 else "")
        return [page.SerializeToString()]

    liar[0].answers = {"ListMeshes": answer}
    assert [one.name for one in call(liar[1], "meshes", asynchronous)] == names and asked == ["", "2", "4"]


@BOTH
@pytest.mark.parametrize("name", CALLS)
def test_a_server_of_another_contract(liar: tuple[Liar, str], name: str, asynchronous: bool) -> None:
    made_for = f"this client was made for revision {CONTRACT_REVISION}"
    text = f"the server at {liar[1]} speaks another version of the contract; {made_for}"
    with pytest.raises(voxelpipe.errors.NotSupported, match=text):
        call(liar[1], name, asynchronous)


# ---- errors ----


def retry_info(seconds: int, nanos: int = 0) -> Any:
    info = error_details_pb2.RetryInfo()
    info.retry_delay.seconds, info.retry_delay.nanos = seconds, nanos
    return info


def limits(x: float = 0, y: float = 0, z: float = 0, **numbers: Any) -> Any:
    """In: the smallest voxel size, and the other numbers by name."""
    limit = error_pb2.LimitExceeded(**numbers)
    if x or y or z:
        limit.voxel_size.x, limit.voxel_size.y, limit.voxel_size.z = x, y, z
    return limit


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
    "numbers that are none": (
        detailed(limits(limit_bytes=-1, need_bytes=-(2**63), resolution=-7)),
        voxelpipe.TooLarge,
        {"limit_bytes": None, "need_bytes": None, "largest_resolution": None, "smallest_voxel_size": None},
    ),
    "a size that is none": (
        detailed(limits(math.nan, 1, 1, limit_bytes=7)),
        voxelpipe.TooLarge,
        {"limit_bytes": 7, "smallest_voxel_size": None},
    ),
    "an infinite size": (
        detailed(limits(1, math.inf, 1, limit_bytes=7)),
        voxelpipe.TooLarge,
        {"smallest_voxel_size": None},
    ),
    "a negative size": (
        detailed(limits(1, 1, -1, limit_bytes=7)),
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
    tell_batch(liar[0], [service.BatchReply(id=0, error=details)])
    trailer = ("grpc-status-details-bin", details.SerializeToString())
    refused = grpc.StatusCode.RESOURCE_EXHAUSTED

    def fail(_: Any, context: Any) -> Iterable[bytes]:
        context.set_trailing_metadata([trailer])
        context.abort(refused, "refused")
        return []

    liar[0].answers["Voxelize"] = fail  # a busy server is asked again, alone
    with pytest.raises(kind, match="refused"):
        ask_many(liar[1])


def test_a_number_of_six_thousand_digits(liar: tuple[Liar, str]) -> None:
    details = detailed(error_details_pb2.ErrorInfo(metadata={"limit_bytes": "9" * 6000}))
    tell_batch(liar[0], [service.BatchReply(id=0, error=details)])
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
