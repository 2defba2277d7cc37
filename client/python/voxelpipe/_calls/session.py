"""What both clients share: options, the channel's settings, metadata, and the messages of each call."""
from __future__ import annotations

import contextlib
import dataclasses
import os
import uuid
from typing import Any, Iterator

import numpy

from .._mesh.forms import MeshFile
from .._mesh.glb import as_numpy
from .._mesh.placed import PlacedMeshes
from .._proto.voxelpipe.v1 import mesh_pb2, request_pb2
from .._proto.voxelpipe.v1 import voxelization_service_pb2 as service
from ..errors import DataLoss, InvalidMesh, InvalidRequest, TooLarge, VoxelpipeError
from ..report import StoredMesh
from ..request import Request, checked_timeout
from . import wire as _wire
from .address import ServerLike, address_of, check_address
from .progress import Reporter

SERVICE = "/voxelpipe.v1.VoxelizationService/"
SMALL_BYTES = 1 << 20  # meshes and results up to this size take one message each
_SYSTEM_CA = "/etc/ssl/certs/ca-certificates.crt"  # gRPC's own list is not installed everywhere
_LOOPBACK = ("localhost:", "127.", "[::1]", "unix:", "ipv4:127.", "ipv6:[::1]")


@dataclasses.dataclass(frozen=True)
class Tls:
    """TLS settings; names of PEM files. ca: trusted certificates; empty: the system's. cert, key: this client's own,
    for servers that require one. server_name: the name in the server's certificate, if it is not the address's host.
    """

    ca: str = ""
    cert: str = ""
    key: str = ""
    server_name: str = ""


@dataclasses.dataclass(frozen=True)
class Options:
    """The options of a client: all that another process needs to make the same one."""

    server: str
    token: str = dataclasses.field(default="", repr=False)
    token_file: str = ""
    tls: Tls | None = None
    timeout: float | None = 600.0
    retries: int = 2
    max_result_bytes: int = 64 << 30
    plaintext_token: bool = False

    @staticmethod
    def of(
        server: ServerLike,
        token: str,
        token_file: "str | os.PathLike[str]",
        tls: Tls | bool,
        timeout: float | None,
        retries: int,
        max_result_bytes: int,
        plaintext_token: bool,
    ) -> "Options":
        """From the arguments of a client. Errors: InvalidRequest."""
        if not (token or token_file):
            token = os.environ.get("VOXELPIPE_TOKEN", "")
        return Options(
            server=address_of(server) or os.environ.get("VOXELPIPE_SERVER", ""),
            token=token,
            token_file=os.fspath(token_file),
            tls=Tls() if tls is True else tls or None,
            timeout=checked_timeout(timeout),
            retries=retries,
            max_result_bytes=max_result_bytes,
            plaintext_token=plaintext_token,
        )

    def check(self) -> None:
        """Errors: InvalidRequest naming the option."""
        check_address(self.server)
        if (self.token or self.token_file) and self.tls is None and not self.plaintext_token:
            if not self.server.startswith(_LOOPBACK):
                raise InvalidRequest(
                    "token: would be sent in plain text to another machine; set tls, or plaintext_token=True",
                    field="token",
                )
        if any(character in self.token for character in " \r\n\t"):
            raise InvalidRequest("token: has spaces or line ends in it", field="token")
        if self.tls is not None and bool(self.tls.cert) != bool(self.tls.key):
            raise InvalidRequest("tls: a certificate needs its key, and a key its certificate", field="tls")

    def channel_options(self) -> list[tuple[str, Any]]:
        """Of grpc.insecure_channel and grpc.secure_channel, sync and aio."""
        options: list[tuple[str, Any]] = [
            ("grpc.max_receive_message_length", -1),
            ("grpc.max_send_message_length", -1),
            ("grpc.http2.max_frame_size", 16777215),  # a quarter faster on gigabytes
            ("grpc.use_local_subchannel_pool", 1),
            ("grpc.initial_reconnect_backoff_ms", 100),  # within it calls fail without an attempt to connect
            ("grpc.max_reconnect_backoff_ms", 250),
            ("grpc.keepalive_time_ms", 10000),
            ("grpc.keepalive_timeout_ms", 15000),
            ("grpc.http2.max_pings_without_data", 0),
            ("grpc.enable_retries", 0),  # this package's own keep to RetryInfo
            ("grpc.compression_enabled_algorithms_bitset", 1),  # none: a message takes the memory that was received
            ("SingleThreadedUnaryStream", 1),  # the sync channel's own; a thread a call would halve small calls
        ]
        if self.server.startswith(_LOOPBACK):
            options.append(("grpc.enable_http_proxy", 0))
        if self.tls is not None and self.tls.server_name:
            options.append(("grpc.ssl_target_name_override", self.tls.server_name))
        return options

    def tls_files(self) -> tuple[bytes | None, bytes | None, bytes | None]:
        """Root certificates, private key, certificate chain. Errors: InvalidRequest naming the file."""
        assert self.tls is not None
        ca = self.tls.ca or (_SYSTEM_CA if os.path.exists(_SYSTEM_CA) else "")
        return _pem(ca), _pem(self.tls.key), _pem(self.tls.cert)

    def metadata(self, request_id: str) -> tuple[tuple[str, str], ...]:
        """Of one call. The token's file is read each time. Errors: InvalidRequest if it cannot be read."""
        token = self.token
        if self.token_file:
            try:
                with open(self.token_file, encoding="utf-8") as file:
                    token = file.read().strip()
            except OSError as error:
                raise InvalidRequest(f"token_file: {self.token_file}: {error.strerror}", field="token_file") from error
        pairs = [("x-request-id", request_id)]
        if token:
            pairs.append(("authorization", f"Bearer {token}"))
        return tuple(pairs)


def _pem(path: str) -> bytes | None:
    if not path:
        return None
    try:
        with open(path, "rb") as file:
            data = file.read()
    except OSError as error:
        raise InvalidRequest(f"tls: {path}: {error.strerror}", field="tls") from error
    if b"-----BEGIN" not in data:
        raise InvalidRequest(f"tls: {path}: holds nothing in PEM", field="tls")
    return data


def new_request_id() -> str:
    """The id of one call, in this client's errors and in the server's log."""
    return uuid.uuid4().hex


def positions_file(positions: Any) -> MeshFile:
    """The bytes of new positions (n, 3) of a kept mesh's vertices. Errors: InvalidRequest."""
    array = as_numpy(positions)
    if array.ndim != 2 or array.shape[1] != 3:
        raise InvalidRequest(f"new_positions: the shape is {array.shape}, expected (n, 3)", field="new_positions")
    if array.dtype.kind not in "fiu" or isinstance(positions, numpy.ma.MaskedArray):
        raise InvalidRequest(f"new_positions: an array of {array.dtype}, expected numbers", field="new_positions")
    with numpy.errstate(over="ignore"):  # what is beyond float32 is refused as not finite
        floats = numpy.ascontiguousarray(array, "<f4")
    return MeshFile(floats.reshape(-1).view(numpy.uint8).data)


def named(error: VoxelpipeError, file: MeshFile | None) -> VoxelpipeError:
    """The error itself; of a mesh that is wrong or too large, its message then begins with the file's name, if any."""
    of_mesh = isinstance(error, (InvalidMesh, TooLarge))
    if of_mesh and file is not None and file.name and not error.message.startswith(file.name):
        error.message = f"{file.name}: {error.message}"
        error.args = (error.message,)
    return error


@contextlib.contextmanager
def naming(file: MeshFile | None) -> Iterator[None]:
    """Errors in this context name the file: see named()."""
    try:
        yield
    except (InvalidMesh, TooLarge) as error:
        named(error, file)
        raise


@dataclasses.dataclass(frozen=True)
class Job:
    """A request with its mesh: the file, or the name of a kept mesh and perhaps new positions; or several that are
    kept, if those of them that have a file are stored first.
    """

    request: Request
    file: MeshFile | None
    stored: str = ""
    placed: PlacedMeshes | None = None

    @property
    def data(self) -> memoryview:
        """The bytes of the file or of the new positions, if any."""
        return memoryview(b"") if self.file is None else self.file.data

    def source(self, with_data: bool) -> _wire.Parts:
        """The MeshSource, with the data or without."""
        if self.placed is not None:
            return _wire.field(request_pb2.MeshSource.PLACED_FIELD_NUMBER, [self.placed.message()])
        kind: Any = request_pb2.MeshPositions if self.stored else request_pb2.MeshBytes
        data: list[Any] = []
        if with_data and self.file is not None:
            data += _wire.checked_bytes(self.data, kind.DATA_FIELD_NUMBER, kind.CRC32C_FIELD_NUMBER)
        if not self.stored:
            if self.file is not None:
                given = kind(format=self.file.format, unit=self.file.unit_code)
                data.append(given.SerializeToString())
            return _wire.field(request_pb2.MeshSource.BYTES_FIELD_NUMBER, data)
        mesh: list[Any] = [request_pb2.StoredMesh(name=self.stored).SerializeToString()]
        if self.file is not None:
            mesh += _wire.field(request_pb2.StoredMesh.POSITIONS_FIELD_NUMBER, data)
        return _wire.field(request_pb2.MeshSource.STORED_FIELD_NUMBER, mesh)

    def message(self, with_data: bool) -> _wire.Parts:
        """The VoxelizeRequest, with the data or without."""
        mesh = _wire.field(request_pb2.VoxelizeRequest.MESH_FIELD_NUMBER, self.source(with_data))
        return [*mesh, self.request.encoded]

    def in_one_message(self) -> bool:
        """True if the mesh fits into one message."""
        return len(self.data) <= SMALL_BYTES

    def small_result(self) -> bool:
        """True if the result surely fits into one message."""
        return self.request.small_result(SMALL_BYTES)

    def whole(self, report: Reporter) -> bytes:
        """The VoxelizeRequest of a call with one message."""
        report("upload", 0.0, 0)
        return b"".join(self.message(True))

    def upload(self, report: Reporter) -> Iterator[bytes]:
        """The VoxelizeUploadRequests of a call."""
        field = service.VoxelizeUploadRequest
        yield b"".join(_wire.field(field.REQUEST_FIELD_NUMBER, self.message(False)))
        yield from _pieces(self.data, field, report)

    def batch_job(self, number: int) -> bytes:
        """A VoxelizeBatchRequest with this job. In: its id."""
        job = [
            _wire.number_field(service.BatchJob.ID_FIELD_NUMBER, number),
            *_wire.field(service.BatchJob.REQUEST_FIELD_NUMBER, self.message(True)),
        ]
        return b"".join(_wire.field(service.VoxelizeBatchRequest.JOBS_FIELD_NUMBER, job))

    def estimate(self) -> bytes:
        """The EstimateVoxelizationRequest."""
        asked = self.request.message
        rest = service.EstimateVoxelizationRequest(spec=asked.spec, execution=asked.execution)
        mesh = _wire.field(service.EstimateVoxelizationRequest.MESH_FIELD_NUMBER, self.source(True))
        return b"".join([*mesh, rest.SerializeToString()])


def _pieces(data: memoryview, field: Any, report: Reporter) -> Iterator[bytes]:
    """The messages of an upload after the first. In: their class."""
    for at in range(0, len(data), _wire.UPLOAD_PIECE_BYTES):
        report("upload", at / len(data), 0)
        piece = data[at : at + _wire.UPLOAD_PIECE_BYTES]
        yield b"".join(_wire.checked_bytes(piece, field.PIECE_FIELD_NUMBER, field.CRC32C_FIELD_NUMBER))


def upload_messages(file: MeshFile, name: str, report: Reporter) -> Iterator[bytes]:
    """The UploadMeshRequests of a mesh. In: its name."""
    upload = mesh_pb2.MeshUpload(format=file.format, unit=file.unit_code, expected_id=name)  # type: ignore[arg-type]
    yield mesh_pb2.UploadMeshRequest(upload=upload).SerializeToString()
    yield from _pieces(file.data, mesh_pb2.UploadMeshRequest, report)


def uploaded(answer: bytes | None, name: str) -> mesh_pb2.Mesh:
    """The answer to an upload. In: the mesh's name. Errors: DataLoss if it is none, or of another mesh."""
    mesh: mesh_pb2.Mesh = _wire.parsed(mesh_pb2.Mesh, answer)
    kept = StoredMesh.of(mesh).name
    if kept != name:
        raise DataLoss(f"the server keeps the mesh {name} as {kept}")
    return mesh


def listed_meshes(answer: bytes | None, token: str) -> tuple[list[StoredMesh], str | None]:
    """A page of meshes, and the token of the next one; None: it is the last. In: its own. Errors: DataLoss."""
    page = _wire.parsed(mesh_pb2.ListMeshesResponse, answer)
    following: str = page.next_page_token
    if following and (following == token or not page.meshes):
        raise DataLoss("the server's answer: a list of meshes without an end")
    return [StoredMesh.of(mesh) for mesh in page.meshes], following or None


def freed_bytes(answer: bytes | None) -> int:
    """The answer to ReleaseMesh. Errors: DataLoss."""
    freed = int(_wire.parsed(mesh_pb2.ReleaseMeshResponse, answer).freed_bytes)
    if freed < 0:
        raise DataLoss(f"the server's answer: freed_bytes is {freed}")
    return freed
