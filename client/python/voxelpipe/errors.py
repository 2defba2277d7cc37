"""The errors of this package, one class a reason. All derive from VoxelpipeError.

An error that a server reports carries its canonical gRPC code in `code` ("INVALID_ARGUMENT", ...), the id of the call
in `request_id` (the `request` of the server's log line), and what its details say in the fields of its class.
"""
from __future__ import annotations

from typing import ClassVar


class VoxelpipeError(Exception):
    """Base class.

    code: canonical gRPC code, upper case; the class's own for errors that no server reported.
    message: one line. request_id: of the call, empty if there was none.
    retryable: True if the same call may succeed later; the client has then tried again as often as it may.
    """

    default_code: ClassVar[str] = "UNKNOWN"
    retryable: ClassVar[bool] = False

    def __init__(self, message: str, *, code: str = "", request_id: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.code = code or self.default_code
        self.request_id = request_id

    def __str__(self) -> str:
        return self.message

    def __reduce__(self) -> tuple[object, ...]:
        return (_restored, (type(self), self.message, self.__dict__))


def _restored(kind: type[VoxelpipeError], message: str, fields: dict[str, object]) -> VoxelpipeError:
    error = kind.__new__(kind)
    Exception.__init__(error, message)
    error.__dict__.update(fields)
    return error


class InvalidRequest(VoxelpipeError, ValueError):
    """INVALID_ARGUMENT: the request is wrong. field: the field at fault, such as "targets[0].blend", or empty."""

    default_code = "INVALID_ARGUMENT"

    def __init__(self, message: str, *, field: str = "", code: str = "", request_id: str = "") -> None:
        super().__init__(message, code=code, request_id=request_id)
        self.field = field


class UnknownOption(InvalidRequest, TypeError):
    """INVALID_ARGUMENT: a keyword is no option of the call, and names no target. field: the keyword."""

    def __init__(self, message: str, field: str) -> None:
        super().__init__(message, field=field)


class InvalidMesh(InvalidRequest):
    """INVALID_ARGUMENT: the mesh is wrong. field: the part of the file at fault: "glTF: mesh 0, primitive 0"."""


class TooLarge(VoxelpipeError):
    """RESOURCE_EXHAUSTED: beyond a limit of the server or of this client.

    need_bytes, limit_bytes: None if unknown. largest_resolution: the largest one that would fit, for a request with a
    resolution. smallest_voxel_size: x, y, z in world units, for a request with a voxel size.
    """

    default_code = "RESOURCE_EXHAUSTED"

    def __init__(
        self,
        message: str,
        *,
        need_bytes: int | None = None,
        limit_bytes: int | None = None,
        largest_resolution: int | None = None,
        smallest_voxel_size: tuple[float, float, float] | None = None,
        code: str = "",
        request_id: str = "",
    ) -> None:
        super().__init__(message, code=code, request_id=request_id)
        self.need_bytes = need_bytes
        self.limit_bytes = limit_bytes
        self.largest_resolution = largest_resolution
        self.smallest_voxel_size = smallest_voxel_size


class Overloaded(VoxelpipeError):
    """RESOURCE_EXHAUSTED: the server is busy. retry_after: seconds that it asks callers to wait, 0 to 3600."""

    default_code = "RESOURCE_EXHAUSTED"
    retryable = True

    def __init__(self, message: str, *, retry_after: float = 0.0, code: str = "", request_id: str = "") -> None:
        super().__init__(message, code=code, request_id=request_id)
        self.retry_after = retry_after


class QuotaExceeded(Overloaded):
    """RESOURCE_EXHAUSTED: a quota of the caller is used up. subject: whose."""

    def __init__(
        self, message: str, *, subject: str = "", retry_after: float = 0.0, code: str = "", request_id: str = ""
    ) -> None:
        super().__init__(message, retry_after=retry_after, code=code, request_id=request_id)
        self.subject = subject


class NotAvailable(VoxelpipeError):
    """FAILED_PRECONDITION: the server lacks something that the request names, such as a backend."""

    default_code = "FAILED_PRECONDITION"


class MeshNotFound(VoxelpipeError, LookupError):
    """NOT_FOUND: the server keeps no mesh of this name. name: "meshes/..."."""

    default_code = "NOT_FOUND"

    def __init__(self, message: str, *, name: str = "", code: str = "", request_id: str = "") -> None:
        super().__init__(message, code=code, request_id=request_id)
        self.name = name


class Unavailable(VoxelpipeError, ConnectionError):
    """UNAVAILABLE: no server answers at the address, or it shuts down.

    retry_after: seconds, None if it says none. connected: False if no connection to a server could be made.
    """

    default_code = "UNAVAILABLE"
    retryable = True

    def __init__(
        self,
        message: str,
        *,
        retry_after: float | None = None,
        connected: bool = True,
        code: str = "",
        request_id: str = "",
    ) -> None:
        super().__init__(message, code=code, request_id=request_id)
        self.retry_after = retry_after
        self.connected = connected


class DeadlineExceeded(VoxelpipeError, TimeoutError):
    """DEADLINE_EXCEEDED: the call took longer than its timeout, or waited for a worker for too long."""

    default_code = "DEADLINE_EXCEEDED"


class Cancelled(VoxelpipeError):
    """CANCELLED: the call was cancelled."""

    default_code = "CANCELLED"


class Unauthenticated(VoxelpipeError):
    """UNAUTHENTICATED: the server needs a token, and got none or an unknown one."""

    default_code = "UNAUTHENTICATED"


class PermissionDenied(VoxelpipeError):
    """PERMISSION_DENIED: the caller's token or claim does not allow this."""

    default_code = "PERMISSION_DENIED"


class DataLoss(VoxelpipeError):
    """DATA_LOSS: bytes were changed on their way, or the server's answer is not valid: a CRC-32C, a SHA-256, an offset
    or a length does not match; a message, a grid, a shape or a list cannot be.
    """

    default_code = "DATA_LOSS"


class Aborted(VoxelpipeError):
    """ABORTED: this client sent or read too little for too long."""

    default_code = "ABORTED"


class NotSupported(VoxelpipeError):
    """UNIMPLEMENTED: the server does not know the call, as it speaks another version of the contract; or there is none.
    """

    default_code = "UNIMPLEMENTED"


class ServerFailed(VoxelpipeError):
    """INTERNAL, UNKNOWN or another code: the server failed."""

    default_code = "INTERNAL"


class MissingPackage(VoxelpipeError, ImportError):
    """A converter needs a Python package that is not installed. package: its name on PyPI."""

    default_code = "FAILED_PRECONDITION"

    def __init__(self, message: str, *, package: str = "") -> None:
        super().__init__(message)
        self.package = package
