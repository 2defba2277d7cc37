"""gRPC, loaded so that child processes can use it. Every module of this package takes it from here."""
from __future__ import annotations

import os
import sys

# gRPC reads this when it is loaded. Without it a child process lacks gRPC's threads: calls hang, or the process aborts.
_TOO_LATE = "grpc" in sys.modules
_ON = os.environ.setdefault("GRPC_ENABLE_FORK_SUPPORT", "1").lower() in ("1", "true", "yes")
FORKS_ARE_SAFE = _ON and not _TOO_LATE

import grpc  # noqa: E402
import grpc.aio  # noqa: E402

__all__ = ["FORKS_ARE_SAFE", "grpc"]
