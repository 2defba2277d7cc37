"""A server that answers every call with headers and bytes that no gRPC library sends.

Sources: RFC 9113 (HTTP/2), section 4; RFC 7541 (HPACK), section 6.2.2; gRPC over HTTP/2.
"""
from __future__ import annotations

import contextlib
import socket
import struct
import threading
from typing import Iterator, Sequence

Headers = Sequence[tuple[str, str]]

_DATA, _HEADERS, _SETTINGS, _PING = 0, 1, 4, 6
_END_STREAM, _ACK, _END_HEADERS = 1, 1, 4
_PREFACE_BYTES = 24
_FRAME = struct.Struct(">BHBBI")  # length (24 bits), type, flags, stream


def _frame(kind: int, flags: int, stream: int, payload: bytes = b"") -> bytes:
    return _FRAME.pack(len(payload) >> 16, len(payload) & 0xFFFF, kind, flags, stream) + payload


def _encoded(headers: Headers) -> bytes:
    """Literal fields without indexing. Texts of at most 126 bytes."""
    fields = [text.encode() for pair in headers for text in pair]
    assert all(len(field) < 127 for field in fields)
    parts = [bytes([len(field)]) + field for field in fields]
    return b"".join(b"\x00" + name + value for name, value in zip(parts[::2], parts[1::2]))


def _serve(connection: socket.socket, headers: Headers, messages: Sequence[bytes], trailers: Headers) -> None:
    first = [(":status", "200"), ("content-type", "application/grpc"), *headers]
    with connection, connection.makefile("rb") as incoming:
        incoming.read(_PREFACE_BYTES)
        connection.sendall(_frame(_SETTINGS, 0, 0))
        while len(head := incoming.read(_FRAME.size)) == _FRAME.size:
            high, low, kind, flags, stream = _FRAME.unpack(head)
            payload = incoming.read(high << 16 | low)
            if kind in (_SETTINGS, _PING) and not flags & _ACK:
                connection.sendall(_frame(kind, _ACK, 0, payload if kind == _PING else b""))
            if kind in (_HEADERS, _DATA) and flags & _END_STREAM:
                answer = _frame(_HEADERS, _END_HEADERS, stream, _encoded(first))
                answer += b"".join(_frame(_DATA, 0, stream, message) for message in messages)
                answer += _frame(_HEADERS, _END_HEADERS | _END_STREAM, stream, _encoded(trailers))
                connection.sendall(answer)


@contextlib.contextmanager
def raw_liar(headers: Headers, messages: Sequence[bytes], trailers: Headers) -> Iterator[str]:
    """A running server. In: the first headers besides the status, data frames, last headers. Out: its address."""
    with socket.create_server(("127.0.0.1", 0)) as listening:

        def accept() -> None:
            with contextlib.suppress(OSError):
                while True:
                    connection, _ = listening.accept()
                    threading.Thread(
                        target=_serve, args=(connection, headers, messages, trailers), daemon=True
                    ).start()

        threading.Thread(target=accept, daemon=True).start()
        yield f"127.0.0.1:{listening.getsockname()[1]}"
        with contextlib.suppress(OSError):
            listening.shutdown(socket.SHUT_RDWR)
