"""From a failed call to the error of its reason. Sources: google/rpc/error_details.proto; gRPC's status trailers."""
from __future__ import annotations

import math
from typing import Any, Iterable

from .. import errors
from .._proto.google.rpc import error_details_pb2 as details_pb2
from .._proto.google.rpc import status_pb2
from .._proto.voxelpipe.v1 import error_pb2
from .._version import CONTRACT_REVISION
from .wire import parsed

_DETAILS = "grpc-status-details-bin"
_PUSHBACK = "grpc-retry-pushback-ms"
_MAX_DELAY_S = 3600.0  # a server's delay counts as at most this
# gRPC's texts, lower case, where it has no connection for a call: it says so in no other way.
_NO_CONNECTION = ("failed to connect to all addresses", "connections to all backends failing", "dns resolution failed")
_BY_CODE: dict[str, type[errors.VoxelpipeError]] = {
    "FAILED_PRECONDITION": errors.NotAvailable,
    "DEADLINE_EXCEEDED": errors.DeadlineExceeded,
    "CANCELLED": errors.Cancelled,
    "UNAUTHENTICATED": errors.Unauthenticated,
    "PERMISSION_DENIED": errors.PermissionDenied,
    "DATA_LOSS": errors.DataLoss,
    "ABORTED": errors.Aborted,
    "UNIMPLEMENTED": errors.NotSupported,
}
_DETAIL_KINDS: tuple[Any, ...] = (
    details_pb2.BadRequest,
    details_pb2.ErrorInfo,
    details_pb2.RetryInfo,
    details_pb2.QuotaFailure,
    details_pb2.ResourceInfo,
    error_pb2.LimitExceeded,
)
_NAMES = (
    "OK CANCELLED UNKNOWN INVALID_ARGUMENT DEADLINE_EXCEEDED NOT_FOUND ALREADY_EXISTS PERMISSION_DENIED "
    "RESOURCE_EXHAUSTED FAILED_PRECONDITION ABORTED OUT_OF_RANGE UNIMPLEMENTED INTERNAL UNAVAILABLE DATA_LOSS "
    "UNAUTHENTICATED"
).split()


def of_call(
    code: str, message: str, trailers: Iterable[Any] | None, target: str, request_id: str
) -> errors.VoxelpipeError:
    """In: the canonical code, and gRPC's text and trailing metadata."""
    status = status_pb2.Status()
    pushback: float | None = None
    for key, value in trailers or ():
        if key == _DETAILS and isinstance(value, bytes):
            try:
                status = parsed(status_pb2.Status, value)
            except errors.DataLoss:  # then the code and the text have to do
                continue
        elif key == _PUSHBACK:
            try:
                pushback = float(value) / 1000
            except ValueError:
                continue
    if code == "UNIMPLEMENTED" and not status.code:  # of gRPC, or of a proxy: errors of the service have details
        why = f": {message}" if message else ""
        message = (
            f"the server at {target} speaks another version of the contract; "
            f"this client was made for revision {CONTRACT_REVISION}{why}"
        )
    return _made(code, message, status, pushback, target, request_id)


def of_cancelled(message: str, target: str, request_id: str) -> errors.Unavailable:
    """The error of a call that ended as CANCELLED although its caller has not cancelled it: a gRPC server that shuts
    down ends new calls so.
    """
    why = "" if message in ("", "CANCELLED") else f": {message}"
    return errors.Unavailable(f"{target}: the server has cancelled the call{why}", request_id=request_id)


def of_status(status: Any, target: str, request_id: str) -> errors.VoxelpipeError:
    """In: the serialized google.rpc.Status of one job of a stream."""
    if status.code == 0:
        return errors.DataLoss("the server's answer: an error of the code OK", request_id=request_id)
    code = _NAMES[status.code] if 0 <= status.code < len(_NAMES) else "UNKNOWN"
    return _made(code, status.message, status, None, target, request_id)


def _made(
    code: str, message: str, status: Any, pushback: float | None, target: str, request_id: str
) -> errors.VoxelpipeError:
    found: dict[str, Any] = {}
    for detail in status.details:
        for kind in _DETAIL_KINDS:
            if detail.type_url.rpartition("/")[2] == kind.DESCRIPTOR.full_name:
                try:
                    found[kind.__name__] = parsed(kind, detail.value)
                except errors.DataLoss:  # as if it were not there
                    continue
    common: dict[str, Any] = {"code": code, "request_id": request_id}
    delay = pushback
    if "RetryInfo" in found:
        retry = found["RetryInfo"].retry_delay
        delay = retry.seconds + retry.nanos / 1e9
    if delay is not None:
        delay = min(max(0.0, delay), _MAX_DELAY_S)
    if code == "INVALID_ARGUMENT":
        violations = found["BadRequest"].field_violations if "BadRequest" in found else []
        field = violations[0].field if violations else ""
        of_mesh = "ErrorInfo" in found and found["ErrorInfo"].reason == "INVALID_MESH"
        return (errors.InvalidMesh if of_mesh else errors.InvalidRequest)(message, field=field, **common)
    if code == "RESOURCE_EXHAUSTED":
        if delay is None:
            return _too_large(message, found.get("LimitExceeded"), common)
        if "QuotaFailure" in found:
            violations = found["QuotaFailure"].violations
            subject = violations[0].subject if violations else ""
            return errors.QuotaExceeded(message, subject=subject, retry_after=delay, **common)
        return errors.Overloaded(message, retry_after=delay, **common)
    if code == "UNAVAILABLE":
        text = message.lower()
        connected = not any(sign in text for sign in _NO_CONNECTION)
        one_side = not connected and any(sign in text for sign in ("socket closed", "wrong version number"))
        hint = " (TLS on one side only?)" if one_side else ""
        return errors.Unavailable(f"{target}: {message}{hint}", retry_after=delay, connected=connected, **common)
    if code == "NOT_FOUND":
        name = found["ResourceInfo"].resource_name if "ResourceInfo" in found else ""
        return errors.MeshNotFound(message, name=name, **common)
    return _BY_CODE.get(code, errors.ServerFailed)(message, **common)


def _too_large(message: str, limit: Any, common: dict[str, Any]) -> errors.TooLarge:
    limit = limit or error_pb2.LimitExceeded()
    size = limit.voxel_size.x, limit.voxel_size.y, limit.voxel_size.z
    return errors.TooLarge(
        message,
        need_bytes=limit.need_bytes if limit.need_bytes > 0 else None,
        limit_bytes=limit.limit_bytes if limit.limit_bytes > 0 else None,
        largest_resolution=limit.resolution if limit.resolution > 0 else None,
        smallest_voxel_size=size if all(0 < axis < math.inf for axis in size) else None,
        **common,
    )
