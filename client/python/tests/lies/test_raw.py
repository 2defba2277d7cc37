"""Answers below gRPC's own interfaces: codes, trailers and frames that no library sends."""
from __future__ import annotations

import gzip
import struct

import pytest

import voxelpipe

from .raw_liar import Headers, raw_liar
from .test_calls import BOTH, call


def framed(message: bytes, compressed: int = 0) -> bytes:
    """A message as gRPC has it in data frames."""
    return struct.pack(">BI", compressed, len(message)) + message


OK = [("grpc-status", "0")]
ANSWERS: dict[str, tuple[Headers, list[bytes], Headers]] = {
    "an unknown code": ([], [], [("grpc-status", "99")]),
    "a negative code": ([], [], [("grpc-status", "-1")]),
    "a code that is no number": ([], [], [("grpc-status", "x")]),
    "no code": ([], [framed(b"")], []),
    "details that are no base64": ([], [], [("grpc-status", "8"), ("grpc-status-details-bin", "!!!!")]),
    "a text that is not encoded": ([], [], [("grpc-status", "3"), ("grpc-message", "%ff%zz%")]),
    "a push-back beyond 64 bits": ([], [], [("grpc-status", "8"), ("grpc-retry-pushback-ms", "9" * 100)]),
    "a compressed message": ([("grpc-encoding", "gzip")], [framed(gzip.compress(bytes(1 << 20)), 1)], OK),
    "an unknown compression": ([("grpc-encoding", "rot13")], [framed(b"abc", 1)], OK),
    "a message that is cut": ([], [framed(bytes(9))[:-1]], OK),
    "a message of 4 GiB that is cut": ([], [b"\0\xff\xff\xff\xffabc"], OK),
}


@BOTH
@pytest.mark.parametrize("name", ["server_info", "upload", "voxelize"])
@pytest.mark.parametrize("answer", ANSWERS)
@pytest.mark.filterwarnings("ignore:Unexpected end-group tag:RuntimeWarning")
def test_an_answer_that_breaks_the_protocol(answer: str, name: str, asynchronous: bool) -> None:
    with raw_liar(*ANSWERS[answer]) as address:
        with pytest.raises(voxelpipe.VoxelpipeError):
            call(address, name, asynchronous)
