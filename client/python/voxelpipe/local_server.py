"""A server of one's own: voxelpiped on a unix socket, for as long as this process wants it."""
from __future__ import annotations

import os
import pathlib
import shutil
import socket
import subprocess
import tempfile
import threading
import urllib.parse
import weakref
from typing import Any, Sequence

from ._calls.core_files import core_files
from .client import Client
from .errors import Unavailable

PROGRAM_VARIABLE = "VOXELPIPE_VOXELPIPED"

# The shell ends the server, and removes its folder, when its standard input closes: also if this process is killed.
_SUPERVISOR = (
    'folder=$1; shift; "$@" & server=$!; exec >&-; read line; kill "$server"; wait "$server"; rm -rf "$folder"'
)
_STOP_S = 10.0
_MAX_SOCKET_PATH_BYTES = 107  # Linux's limit


def _socket_of(folder: str) -> str:
    return f"{folder}/socket"


def _address_of(folder: str) -> str:
    return "unix:" + urllib.parse.quote(_socket_of(folder))  # a folder may have any characters, and an address not


def _make_folder() -> str:
    """A folder of this process alone, in which the path of a socket is short enough."""
    folder = tempfile.mkdtemp(prefix="voxelpipe-")
    if len(os.fsencode(_socket_of(folder))) <= _MAX_SOCKET_PATH_BYTES:
        return folder
    os.rmdir(folder)
    return tempfile.mkdtemp(prefix="voxelpipe-", dir="/tmp")


def find_program() -> str:
    """The path of voxelpiped: the variable VOXELPIPE_VOXELPIPED, PATH, the package voxelpipe-core, or build/bin of the
    source tree of this package.

    Errors: FileNotFoundError saying where it was looked for.
    """
    named = os.environ.get(PROGRAM_VARIABLE, "")
    if named:
        if os.access(named, os.X_OK):
            return named
        raise FileNotFoundError(f"{PROGRAM_VARIABLE}={named}: is no program")
    found = shutil.which("voxelpiped")
    if found:
        return found
    built = pathlib.Path(__file__).resolve().parents[3] / "build" / "bin" / "voxelpiped"
    for path in [*core_files("bin/voxelpiped"), built]:
        if os.access(path, os.X_OK):
            return str(path)
    raise FileNotFoundError(
        f"voxelpiped was not found: neither {PROGRAM_VARIABLE} nor PATH has it. Install voxelpipe-core, or give the "
        "address of a running server: server='HOST:PORT', or the variable VOXELPIPE_SERVER"
    )


def _quick_end(options: Sequence[str]) -> list[str]:
    """Nobody else uses the server: it need not wait for others."""
    quick = {"--lame-duck-ms": "0", "--drain-grace-ms": "500"}
    given = {option.partition("=")[0] for option in options}
    return [word for name, value in quick.items() if name not in given for word in (name, value)]


class LocalServer:
    """A running voxelpiped. server: its address. A context manager; also ends with this process."""

    restarts = False  # once it has ended, no other one starts at its address

    def __init__(self, process: "subprocess.Popen[str]", folder: str) -> None:
        self._folder = folder
        self.server = _address_of(folder)
        self._end = weakref.finalize(self, _stop, process, folder, os.getpid())

    def client(self, **options: Any) -> Client:
        """A new client of it. options: those of Client."""
        return Client(self, **options)

    def is_running(self) -> bool:
        """True if it takes connections."""
        with socket.socket(socket.AF_UNIX) as connection:
            return connection.connect_ex(_socket_of(self._folder)) == 0

    def stop(self) -> None:
        """Ends the server."""
        self._end()

    def __enter__(self) -> "LocalServer":
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def __repr__(self) -> str:
        return f"<voxelpipe.LocalServer at {self.server}>"


def local_server(*, program: str = "", options: Sequence[str] = (), timeout: float = 30.0) -> LocalServer:
    """Starts voxelpiped on a unix socket, and waits until it serves.

    The socket is in a new folder of TMPDIR, or of /tmp where the path of TMPDIR is too long for a socket.

    program: its path; empty: find_program(). options: further ones of its command line, such as ["--threads", "4"].
    timeout: seconds. Errors: FileNotFoundError; Unavailable with what it printed if it does not start.
    """
    path = program or find_program()
    folder = _make_folder()
    try:
        with open(os.path.join(folder, "log"), "w", encoding="utf-8") as log:
            process = subprocess.Popen(
                [
                    "sh",
                    "-c",
                    _SUPERVISOR,
                    "sh",
                    folder,
                    path,
                    "--listen",
                    _address_of(folder),
                    *_quick_end(options),
                    *options,
                ],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=log,
                text=True,
                start_new_session=True,  # Ctrl-C is for this process alone
            )
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    server = LocalServer(process, folder)
    late = threading.Timer(timeout, server.stop)
    late.start()
    try:
        assert process.stdout is not None
        for line in process.stdout:
            if line.startswith("listening on "):
                return server
    finally:
        late.cancel()
    try:
        text = pathlib.Path(folder, "log").read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        text = f"it did not serve within {timeout:g} s"
    server.stop()
    raise Unavailable(f"{path} does not start: {'; '.join(text.splitlines()[:3]) or 'it ended'}")


def _stop(process: "subprocess.Popen[str]", folder: str, pid: int) -> None:
    if os.getpid() != pid:
        return  # in a child process: the server is its parent's
    for stream in (process.stdin, process.stdout):
        if stream is not None:
            stream.close()
    try:
        process.wait(_STOP_S)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, 9)
        process.wait()
    shutil.rmtree(folder, ignore_errors=True)
