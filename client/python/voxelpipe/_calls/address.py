"""Addresses of servers, by the rules of client/cpp/address.h."""
from __future__ import annotations

import re
from typing import Any, Protocol, Union

from ..errors import InvalidRequest

# Names of gRPC that have no port, or several.
_OTHER_NAMES = ("unix:", "unix-abstract:", "vsock:", "ipv4:", "ipv6:", "xds:")


class Addressed(Protocol):
    """A LocalServer, or a Client."""

    @property
    def server(self) -> str:
        """The address."""


ServerLike = Union[str, Addressed]


def address_of(server: ServerLike) -> str:
    """The address in text. Errors: TypeError."""
    address: Any = server if isinstance(server, str) else getattr(server, "server", None)
    if not isinstance(address, str):
        kind = type(server).__name__
        raise TypeError(f"server: a {kind} is no address; expected HOST:PORT, a LocalServer or a Client")
    return address


def check_address(address: str) -> None:
    """Errors: InvalidRequest, field "server", unless a server may have this address."""
    fault = _fault(address)
    if fault:
        raise InvalidRequest(f"server: '{address}' {fault}; expected HOST:PORT or unix:/PATH", field="server")


def _fault(address: str) -> str:
    if address.startswith(_OTHER_NAMES):
        return ""
    if address.startswith("dns:"):
        address = address[4:].rpartition("/")[2]
    if "://" in address:
        return "is a URL"
    host, colon, port = address.rpartition(":")
    if not colon or address.endswith("]"):
        return "has no port"
    if not host:
        return "has no host"
    if ":" in host and not (host.startswith("[") and host.endswith("]")):
        return "has more than one colon; an IPv6 address stands in brackets"
    if not re.fullmatch("[0-9]{1,5}", port) or not 1 <= int(port) <= 65535:
        return f"has the port '{port}', which is none from 1 to 65535"
    return ""
